"""Verbs of a drive, shared by `Drive` and `AsyncDrive`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.bus.call_styles import Verb
from drivecomm.bus.parameter_names import ParameterNames
from drivecomm.bus.peer_verbs import B, PeerVerbs
from drivecomm.bus.read_only import ReadOnly
from drivecomm.bus.reading_many import ManyReads
from drivecomm.errors import UsageError
from drivecomm.line import Job, Rank
from drivecomm.protocol import DESCRIBE, Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.errors import DriveCommError
    from drivecomm.link import Peer
    from drivecomm.protocol import (
        DriveStatus,
        Exchange,
        LineFacts,
        MachineUnit,
        Model,
        Operations,
        Reading,
        StopName,
        Value,
    )

T = TypeVar("T")


# Local names, because a NamedTuple's constructor and looking up an enumeration member call Python functions.
_new = tuple.__new__
_READ = Rank.READ
_POLL = Rank.POLL


class DriveVerbs(PeerVerbs[B]):
    """Verbs of one addressed drive."""

    _inner = frozenset(
        {
            "blocks",
            "check_read",
            "check_write",
            "polled",
            "polled_many",
            "polled_status",
            "poller",
            "to_poll_many",
            "to_status",
            "watched",
        }
    )

    def __init__(
        self, bus: B, peer: Peer, operations: Operations, model: Model | None, machine: MachineUnit | None = None
    ) -> None:
        super().__init__(bus, peer, operations, model, machine)
        self.model = model

    @property
    def name(self) -> str:
        """The drive as the command line names it, such as "vabus:1"."""
        return self._peer.name

    @property
    def machine(self) -> MachineUnit | None:
        """The unit in which its machine counts its speed; None if it is unknown."""
        return self._exchanges.references.machine

    @property
    def parameters(self) -> ParameterNames:
        """The parameters of its model, by name; a prompt completes `drive.parameters.NAME`."""
        return ParameterNames(self.name, self.model)

    @property
    def facts(self) -> LineFacts:
        """Line settings and timing of this drive."""
        return self._peer.facts

    @property
    def read_only_reason(self) -> str:
        """The sentence with which writes and commands are refused; empty for a drive that is not read-only.

        It can be set to name the reason why the drive is read-only, such as a plant file.
        """
        operations = self._exchanges.operations
        return operations.reason if isinstance(operations, ReadOnly) else ""

    @read_only_reason.setter
    def read_only_reason(self, reason: str) -> None:
        operations = self._exchanges.operations
        if not isinstance(operations, ReadOnly):
            raise UsageError(f"{self.name} is not read-only; make it with read_only=True", says="read_only=True")
        operations.reason = reason

    @property
    def in_ram_only(self) -> frozenset[str]:
        """The addresses of parameters that were written through this bus, and that the drive loses without power.

        The values that the drive has stored for them are unknown: a read returns the value in use, which is the written
        one.
        """
        return self._bus.in_ram_only(self._peer)

    def watched(self, silence_s: float | None) -> None:
        """Record how many seconds this drive's watchdog waits for its master, None if it is off; sends nothing.

        If such a watchdog counts from the last command (Danfoss FC), `status` then repeats the last command, unless it
        is older than this time: the drive has then acted by itself. `set_watchdog`, `read_watchdog` and `keep` call
        this method.
        """
        self._bus.watched(self._peer, silence_s)

    @Verb
    def read(self, /, parameter: str, **options: Any) -> Job[Reading]:
        """Read a parameter, by its address in the protocol's form or by its name in the drive's model.

        options: the protocol's own options, such as type= (vabus, danfoss-fc) or dataset= (vabus).
        """
        return _new(Job, (self._peer, self._exchanges.to_read(parameter, options), _READ, None, False, None))

    @Verb
    def polled(self, /, parameter: str, **options: Any) -> Job[Reading]:
        """Read a parameter with the rank of a poll: stops, commands and reads of other callers go first."""
        return _new(Job, (self._peer, self._exchanges.to_read(parameter, options), _POLL, None, False, None))

    def poller(self, parameter: str, options: Mapping[str, Any]) -> Callable[[], Job[Reading]]:
        """Return a function that makes a new job of `polled` at each call; sends nothing."""
        peer, read = self._peer, self._exchanges.reader(parameter, options)
        return lambda: _new(Job, (peer, read(), _POLL, None, False, None))

    @Verb
    def read_many(self, /, parameters: Sequence[str]) -> Job[list[Reading | DriveCommError]]:
        """Read parameters, with as few telegrams as the protocol and the drive allow; results are in the given order.

        The result of a parameter that the drive refuses is the error that `read` would raise. Each reading has the time
        of its own telegram. Errors that concern all parameters are raised: a drive that does not answer, a parameter
        that can never be read.
        """
        return Job(self._peer, self._many.to_read_many(parameters))

    @Verb
    def polled_many(self, /, parameters: Sequence[str]) -> Job[list[Reading]]:
        """Read the parameters of one of the `blocks` with the rank of a poll.

        A drive refuses all of them or none.
        """
        return self.to_poll_many(parameters)

    def to_poll_many(self, parameters: Sequence[str]) -> Job[list[Reading]]:
        """Return the job of `polled_many`; sends nothing."""
        return Job(self._peer, self._many.to_read_block(parameters), Rank.POLL)

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return groups of parameters that one telegram reads, as indexes of the list; sends nothing."""
        return self._many.blocks(parameters)

    @property
    def _many(self) -> ManyReads:
        return ManyReads(self._exchanges, self._bus.wall_time)

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError if `read` can never read this parameter of this drive; sends nothing."""
        self._exchanges.check_read(parameter, options)

    @Verb
    def write(
        self, /, parameter: str, value: Value | float, *, store: bool = False, **options: Any
    ) -> Job[Reading | None]:
        """Write a parameter; return the value that the drive reports back, None if it only confirms.

        value: physical if the model knows the scale, in the quantity's unit for a common name, or the text of one of
        the parameter's options. store: whether to keep the value over power-off (EEPROM), if the protocol makes that
        difference. Before anything is sent, a value that does not fit raises ValueRefusedError, and a parameter that
        was stored too often within an hour raises UsageError, because EEPROM cells wear out.
        """
        given = {"store": store, **options}
        return self._write(parameter, given, self._exchanges.to_write(parameter, value, given))

    @Verb
    def write_and_read(
        self, /, parameter: str, value: Value | float, *, store: bool = False, **options: Any
    ) -> Job[Reading | None]:
        """Write a parameter as `write` does, and read it back. Raises StateError if the drive holds another value."""
        given = {"store": store, **options}
        return self._write(parameter, given, self._exchanges.to_write_and_read(parameter, value, given))

    def check_write(self, parameter: str, value: Value | float, *, store: bool = False, **options: Any) -> None:
        """Raise the errors that `write` raises before sending; sends nothing."""
        self._exchanges.to_write(parameter, value, {"store": store, **options}).close()

    def may_start(self, verb: str, /, **arguments: Any) -> bool:
        """Return whether a verb of this drive may start its motor; sends nothing.

        verb: a verb such as "call" or "write", with its arguments: may_start("write", parameter="410", value=15). The
        result is True even if the start depends on the drive's settings. Raises the errors that the verb raises before
        sending.
        """
        return self._exchanges.may_start(verb, arguments)

    @Verb
    def status(self) -> Job[DriveStatus]:
        """Read the status word; commands nothing new.

        If a drive's watchdog counts from its last command (Danfoss FC) and is known to be on (`watched`), the last
        command of this bus is then repeated, if the status just read shows that the drive still obeys it.
        """
        return self.to_status(Rank.READ)

    @Verb
    def polled_status(self) -> Job[DriveStatus]:
        """Read the status as `status` does, with the rank of a poll: stops, commands and other reads go first."""
        return self.to_status(_POLL)

    def to_status(self, rank: Rank) -> Job[DriveStatus]:
        """Return the job of `status` with another rank; sends nothing."""
        return Job(self._peer, self._exchanges.operations.status(), rank)

    @Verb
    def start(self, *, reverse: bool = False) -> Job[None]:
        """Start the motor with the reference that is set.

        Its behaviour when this program falls silent is a setting of the drive: see `capabilities.link_loss`.
        """
        return self._command(self._exchanges.to_start(reverse=reverse))

    @Verb
    def stop(self, how: Stop | StopName = Stop.RAMP) -> Job[None]:
        """Stop the motor; goes before all else on the line, and is sent even to a drive that has not answered."""
        stopping = partial(self._exchanges.to_stop, how)
        return self._stop(stopping(), again=stopping)

    @Verb
    def reset(self) -> Job[None]:
        """Acknowledge a fault. This does not start the motor again."""
        return self._command(self._exchanges.operations.reset())

    @Verb
    def reverse(self) -> Job[None]:
        """Start the motor backwards, or reverse a running one."""
        return self._command(self._exchanges.to_start(reverse=True))

    @Verb
    def set_reference(
        self,
        *,
        percent: Value | float | None = None,
        hz: Value | float | None = None,
        rpm: Value | float | None = None,
        machine: Value | float | None = None,
    ) -> Job[None]:
        """Set the reference, as a share of the reference range, as output frequency or as speed; never stored.

        rpm: speed of the motor's field, converted by the name plate data in the drive; a loaded motor turns more
        slowly, by its slip. machine: speed in the unit of `machine`, a number or a text such as "12.5 m/min"; set as
        the nearest 0.01 Hz. Raises UsageError unless exactly one of them is given. Raises ValueRefusedError, before a
        reference is sent, for one above `capabilities.reference_limit` or the drive's maximum frequency, in either
        direction, and for another unit.
        """
        return self._command(self._exchanges.to_set_reference(percent, hz, rpm, machine))

    @Verb
    def jog(self, number: int = 1) -> Job[None]:
        """Run at a jog speed until the next start or stop. Raises NotSupported if the drive has none."""
        return self._command(self._exchanges.common("jog", {"number": number}))

    @Verb
    def hold(self) -> Job[None]:
        """Keep the present output frequency of a running motor until the next start or stop."""
        return self._command(self._exchanges.common("hold", {}))

    @Verb
    def select_setup(self, number: int) -> Job[None]:
        """Activate a set-up of parameters, counted from 1."""
        return self._command(self._exchanges.common("select_setup", {"number": number}))

    @Verb
    def select_preset(self, number: int) -> Job[None]:
        """Use a preset reference, counted from 1."""
        return self._command(self._exchanges.common("select_preset", {"number": number}))

    @Verb
    def set_relay(self, number: int, on: bool) -> Job[None]:
        """Switch a relay, counted from 1, on or off."""
        return self._command(self._exchanges.common("set_relay", {"number": number, "on": on}))

    @Verb
    def probe(self) -> Job[None]:
        """Check once whether the drive answers, by a request that cannot move a motor. Raises ReplyError if not."""
        return Job(self._peer, self._exchanges.operations.probe(), insists=True)

    @Verb
    def identify(self) -> Job[Mapping[str, str]]:
        """Read the identity of the drive: name plate, software, address; empty if it reports none."""
        return Job(self._peer, self._exchanges.operations.identify())

    @Verb
    def call(self, /, verb: str, **arguments: Any) -> Job[Any]:
        """Carry out a verb that only this protocol has, such as jogging or choosing a set-up.

        The protocol's documentation lists its verbs with their arguments. Raises NotSupported for an unknown verb.
        """
        exchange = self._exchanges.call(verb, arguments)
        # A description is only read, which is safe even by the model of another series.
        return Job(self._peer, exchange) if verb == DESCRIBE else self._command(exchange)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"


class BroadcastVerbs(PeerVerbs[B]):
    """Verbs that are broadcast to all drives of a protocol."""

    @Verb
    def write(self, /, parameter: str, value: Value | float, **options: Any) -> Job[None]:
        """Write a parameter of all drives; returns when the telegram is sent."""
        return self._write(parameter, options, _without_reply(self._exchanges.to_write(parameter, value, options)))

    @Verb
    def stop(self, how: Stop | StopName = Stop.RAMP) -> Job[None]:
        """Stop all motors; goes before all else on the line, and returns when the telegram is sent."""
        return self._stop(self._exchanges.to_stop(how))


def _without_reply(exchange: Exchange[Reading | None]) -> Exchange[None]:
    yield from exchange
