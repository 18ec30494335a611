"""One drive on a bus: the one interface to drives of every maker."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.bus.turns import Rank
from drivecomm.bus.verbs import Verbs
from drivecomm.bus.waiting import POLL_S, Waiting
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus.waiting import Goal
    from drivecomm.link import CommandCall, Party
    from drivecomm.protocol import Capabilities, DriveStatus, Exchange, LineFacts, Model, Operations, Reading, Value

T = TypeVar("T")
R = TypeVar("R", "Reading", "Reading | None")


class Runs(Protocol):
    """What a drive needs of its bus."""

    def run(self, party: Party, exchange: Exchange[T], rank: Rank = ..., command: CommandCall | None = ...) -> T:
        """Carry out an exchange, unless the drive is known not to answer."""
        ...

    def reading(self, party: Party, exchange: Exchange[R], rank: Rank = ..., command: CommandCall | None = ...) -> R:
        """Carry out an exchange that results in a reading, and give it the time of its reply."""
        ...

    def insist(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange whatever is known of the drive."""
        ...

    def stop(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange that stops a motor, before all else."""
        ...

    def command(self, party: Party) -> CommandCall:
        """Take note that a drive is to be commanded."""
        ...

    def watched(self, party: Party, silence_s: float | None) -> None:
        """Take note how long a drive's watchdog waits."""
        ...

    def wall_time(self) -> float:
        """Return the time for people."""
        ...

    def now(self) -> float:
        """Return the time on the line's clock."""
        ...

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself."""
        ...

    def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock."""
        ...

    def storing(self, party: Party, parameter: str) -> None:
        """Count a write that may end in EEPROM. Raises UsageError for one too many."""
        ...


class Drive:
    """One addressed drive, made by `Bus.drive`; every verb is one exchange on the bus.

    A verb may raise LinkError (port or line), ReplyError (no believable reply), DriveError (the drive said no), and
    UsageError before anything is sent. A drive that does not answer is given up after some time: its verbs then raise
    NotAnsweringError at once, and now and then ask again; only `stop` and `probe` always ask.

    A stop goes before everything: what waits for a reply meanwhile raises OvertakenError, and commands for the same
    drive that were called before it and are not carried out yet raise CommandCancelledError.
    """

    def __init__(self, bus: Runs, party: Party, operations: Operations, model: Model | None) -> None:
        self._bus = bus
        self._party = party
        self._verbs = Verbs(party.name, operations, model)
        self.model = model

    @property
    def name(self) -> str:
        """The drive as the command line names it, such as "vabus:1"."""
        return self._party.name

    @property
    def facts(self) -> LineFacts:
        """Line settings and timing of this drive."""
        return self._party.facts

    @property
    def party(self) -> Party:
        """The drive as the link sees it."""
        return self._party

    @property
    def bus(self) -> Runs:
        """The bus that it is on."""
        return self._bus

    @property
    def capabilities(self) -> Capabilities:
        """What this drive can be asked to do."""
        return self._verbs.capabilities

    def watched(self, silence_s: float | None) -> None:
        """Say how long this drive's watchdog waits for its master, None when it is off; sends nothing.

        Where such a watchdog counts from the last command (Danfoss FC), `status` then repeats what was commanded, as
        long as that is not older than this: the drive has acted by itself then. `set_watchdog`, `read_watchdog` and
        `keep` call this.
        """
        self._bus.watched(self._party, silence_s)

    def read(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter, by its address in the protocol's form or by its name in the drive's model.

        options: the protocol's own, such as type= (vabus, danfoss-fc) or dataset= (vabus).
        """
        return self._bus.reading(self._party, self._verbs.read(parameter, options))

    def polled(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter when nobody else wants the line: everything else overtakes it."""
        return self._bus.reading(self._party, self._verbs.read(parameter, options), Rank.POLL)

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for what `read` could never read on this drive; sends nothing."""
        self._verbs.check_read(parameter, options)

    def write(self, parameter: str, value: Value | float, *, store: bool = False, **options: Any) -> Reading | None:
        """Write a parameter; returns what the drive reports back, None where it only confirms.

        value: physical where the model knows the scale, in the quantity's unit for a common name, or the text of one of
        its options. store: keep the value over power-off (EEPROM) where the protocol makes the difference. A value that
        does not fit raises ValueRefusedError before anything is sent, and so does a UsageError for a parameter that was
        stored too often within an hour: EEPROM cells wear out.
        """
        given = {"store": store, **options}
        return self._write(parameter, given, self._verbs.write(parameter, value, given))

    def write_and_read(
        self, parameter: str, value: Value | float, *, store: bool = False, **options: Any
    ) -> Reading | None:
        """Write a parameter as `write` does, and read it back. Raises StateError when the drive holds another value."""
        given = {"store": store, **options}
        return self._write(parameter, given, self._verbs.written_and_read(parameter, value, given))

    def check_write(self, parameter: str, value: Value | float, *, store: bool = False, **options: Any) -> None:
        """Raise what `write` would raise before it sends anything; sends nothing."""
        self._verbs.write(parameter, value, {"store": store, **options}).close()

    def status(self) -> DriveStatus:
        """Read the status word; commands nothing new.

        Where a drive's watchdog counts from its last command (Danfoss FC) and is known to be on (`watched`), the
        command that this bus has given is then repeated, if the status just read says that the drive obeys it still.
        """
        return self._bus.run(self._party, self._verbs.operations.status())

    def start(self, *, reverse: bool = False) -> None:
        """Start the motor with the reference that is set.

        What stops it when this program falls silent is a setting of the drive: see `capabilities.link_loss`.
        """
        self._command(self._verbs.start(reverse=reverse))

    def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop the motor; overtakes all else on the line, and asks also a drive that has not answered."""
        self._bus.stop(self._party, self._verbs.stop(how))

    def reset(self) -> None:
        """Acknowledge a fault. The motor does not start again by this."""
        self._command(self._verbs.operations.reset())

    def reverse(self) -> None:
        """Start the motor backwards, or let a running one turn round."""
        self.start(reverse=True)

    def set_reference(
        self,
        *,
        percent: Value | float | None = None,
        hz: Value | float | None = None,
        rpm: Value | float | None = None,
    ) -> None:
        """Set the reference, as a share of the reference range, as output frequency or as speed; never stored.

        rpm: of the motor's field, which its name plate in the drive gives; a loaded motor slips below it. Raises
        UsageError unless exactly one of them is given.
        """
        self._command(self._verbs.set_reference(percent, hz, rpm))

    def jog(self, number: int = 1) -> None:
        """Run at a jog speed until the next start or stop. Raises NotSupported where there is none."""
        self._command(self._verbs.common("jog", {"number": number}))

    def hold(self) -> None:
        """Keep the output frequency of a running motor as it is until the next start or stop."""
        self._command(self._verbs.common("hold", {}))

    def select_setup(self, number: int) -> None:
        """Work with this set-up of parameters, from 1 on."""
        self._command(self._verbs.common("select_setup", {"number": number}))

    def select_preset(self, number: int) -> None:
        """Take this preset reference, from 1 on."""
        self._command(self._verbs.common("select_preset", {"number": number}))

    def set_relay(self, number: int, on: bool) -> None:
        """Switch a relay, from 1 on."""
        self._command(self._verbs.common("set_relay", {"number": number, "on": on}))

    def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; returns that status.

        Others use the line meanwhile. Raises StateError when it does not come there in time, and at once when it has a
        fault that is not waited for.
        """
        waiting = Waiting(self.name, goal, timeout_s, self._bus.now())
        while not waiting.over(status := self.status(), now := self._bus.now()):
            self._bus.sleep_until(now + POLL_S)
        return status

    def probe(self) -> None:
        """Ask once whether a drive is there, with something that cannot move a motor. Raises ReplyError if not."""
        self._bus.insist(self._party, self._verbs.operations.probe())

    def identify(self) -> Mapping[str, str]:
        """Read what the drive tells of itself: name plate, software, address; empty when it tells nothing."""
        return self._bus.run(self._party, self._verbs.operations.identify())

    def call(self, verb: str, **arguments: Any) -> Any:
        """Carry out a verb that only this protocol has, such as jogging or choosing a set-up.

        The protocol's documentation lists them with their arguments. Raises NotSupported for a verb that it lacks.
        """
        return self._command(self._verbs.call(verb, arguments))

    def _write(self, parameter: str, options: Mapping[str, Any], exchange: Exchange[Reading | None]) -> Reading | None:
        if stored := self._verbs.stored_parameter(parameter, options):
            self._bus.storing(self._party, stored)
        return self._bus.reading(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    def _command(self, exchange: Exchange[T]) -> T:
        return self._bus.run(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    def __repr__(self) -> str:
        return f"<Drive {self.name}>"


class Broadcast:
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""

    def __init__(self, bus: Runs, party: Party, operations: Operations) -> None:
        self._bus = bus
        self._party = party
        self._verbs = Verbs(party.name, operations)

    @property
    def party(self) -> Party:
        """All drives as the link sees them."""
        return self._party

    @property
    def capabilities(self) -> Capabilities:
        """What all of them at once can be asked to do."""
        return self._verbs.capabilities

    def write(self, parameter: str, value: Value | float, **options: Any) -> None:
        """Write a parameter of all drives; returns when the telegram is sent."""
        exchange = self._verbs.write(parameter, value, options)
        if stored := self._verbs.stored_parameter(parameter, options):
            self._bus.storing(self._party, stored)
        self._bus.run(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop all motors; overtakes all else on the line, and returns when the telegram is sent."""
        self._bus.stop(self._party, self._verbs.stop(how))
