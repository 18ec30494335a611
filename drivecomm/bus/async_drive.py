"""One drive on a bus, for callers that await: the same verbs as `drivecomm.bus.drive`."""

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


class AsyncRuns(Protocol):
    """What a drive needs of its bus."""

    async def run(self, party: Party, exchange: Exchange[T], rank: Rank = ..., command: CommandCall | None = ...) -> T:
        """Carry out an exchange, unless the drive is known not to answer."""
        ...

    async def reading(
        self, party: Party, exchange: Exchange[R], rank: Rank = ..., command: CommandCall | None = ...
    ) -> R:
        """Carry out an exchange that results in a reading, and give it the time of its reply."""
        ...

    async def insist(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange whatever is known of the drive."""
        ...

    async def stop(self, party: Party, exchange: Exchange[T]) -> T:
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

    async def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock."""
        ...

    def storing(self, party: Party, parameter: str) -> None:
        """Count a write that may end in EEPROM. Raises UsageError for one too many."""
        ...


class AsyncDrive:
    """One addressed drive, made by `AsyncBus.drive`; every verb is one exchange on the bus, and raises as `Drive`'s do.

    Cancelling a verb leaves the bus usable; whether the drive acted on a command that was cancelled is not known.
    """

    def __init__(self, bus: AsyncRuns, party: Party, operations: Operations, model: Model | None) -> None:
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
    def bus(self) -> AsyncRuns:
        """The bus that it is on."""
        return self._bus

    @property
    def capabilities(self) -> Capabilities:
        """What this drive can be asked to do."""
        return self._verbs.capabilities

    def watched(self, silence_s: float | None) -> None:
        """Say how long this drive's watchdog waits for its master, None when it is off; sends nothing."""
        self._bus.watched(self._party, silence_s)

    async def read(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter, by its address in the protocol's form or by its name in the drive's model."""
        return await self._bus.reading(self._party, self._verbs.read(parameter, options))

    async def polled(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter when nobody else wants the line: everything else overtakes it."""
        return await self._bus.reading(self._party, self._verbs.read(parameter, options), Rank.POLL)

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for what `read` could never read on this drive; sends nothing."""
        self._verbs.check_read(parameter, options)

    async def write(
        self, parameter: str, value: Value | float, *, store: bool = False, **options: Any
    ) -> Reading | None:
        """Write a parameter; returns what the drive reports back, None where it only confirms."""
        given = {"store": store, **options}
        return await self._write(parameter, given, self._verbs.write(parameter, value, given))

    async def write_and_read(
        self, parameter: str, value: Value | float, *, store: bool = False, **options: Any
    ) -> Reading | None:
        """Write a parameter, and read it back. Raises StateError when the drive holds another value."""
        given = {"store": store, **options}
        return await self._write(parameter, given, self._verbs.written_and_read(parameter, value, given))

    def check_write(self, parameter: str, value: Value | float, *, store: bool = False, **options: Any) -> None:
        """Raise what `write` would raise before it sends anything; sends nothing."""
        self._verbs.write(parameter, value, {"store": store, **options}).close()

    async def status(self) -> DriveStatus:
        """Read the status word; commands nothing."""
        return await self._bus.run(self._party, self._verbs.operations.status())

    async def start(self, *, reverse: bool = False) -> None:
        """Start the motor with the reference that is set; see `capabilities.link_loss` for what stops it."""
        await self._command(self._verbs.start(reverse=reverse))

    async def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop the motor; overtakes all else on the line, and asks also a drive that has not answered."""
        await self._bus.stop(self._party, self._verbs.stop(how))

    async def reset(self) -> None:
        """Acknowledge a fault. The motor does not start again by this."""
        await self._command(self._verbs.operations.reset())

    async def reverse(self) -> None:
        """Start the motor backwards, or let a running one turn round."""
        await self.start(reverse=True)

    async def set_reference(
        self,
        *,
        percent: Value | float | None = None,
        hz: Value | float | None = None,
        rpm: Value | float | None = None,
    ) -> None:
        """Set the reference, as a share of the reference range, as output frequency or as speed; never stored."""
        await self._command(self._verbs.set_reference(percent, hz, rpm))

    async def jog(self, number: int = 1) -> None:
        """Run at a jog speed until the next start or stop."""
        await self._command(self._verbs.common("jog", {"number": number}))

    async def hold(self) -> None:
        """Keep the output frequency of a running motor as it is until the next start or stop."""
        await self._command(self._verbs.common("hold", {}))

    async def select_setup(self, number: int) -> None:
        """Work with this set-up of parameters, from 1 on."""
        await self._command(self._verbs.common("select_setup", {"number": number}))

    async def select_preset(self, number: int) -> None:
        """Take this preset reference, from 1 on."""
        await self._command(self._verbs.common("select_preset", {"number": number}))

    async def set_relay(self, number: int, on: bool) -> None:
        """Switch a relay, from 1 on."""
        await self._command(self._verbs.common("set_relay", {"number": number, "on": on}))

    async def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; returns that status."""
        status = await self.status()
        waiting = Waiting(self.name, goal, timeout_s, self._bus.now())
        while not waiting.over(status, now := self._bus.now()):
            await self._bus.sleep_until(now + POLL_S)
            status = await self.status()
        return status

    async def probe(self) -> None:
        """Ask once whether a drive is there, with something that cannot move a motor. Raises ReplyError if not."""
        await self._bus.insist(self._party, self._verbs.operations.probe())

    async def identify(self) -> Mapping[str, str]:
        """Read what the drive tells of itself: name plate, software, address; empty when it tells nothing."""
        return await self._bus.run(self._party, self._verbs.operations.identify())

    async def call(self, verb: str, **arguments: Any) -> Any:
        """Carry out a verb that only this protocol has, such as jogging or choosing a set-up."""
        return await self._command(self._verbs.call(verb, arguments))

    async def _write(
        self, parameter: str, options: Mapping[str, Any], exchange: Exchange[Reading | None]
    ) -> Reading | None:
        if stored := self._verbs.stored_parameter(parameter, options):
            self._bus.storing(self._party, stored)
        return await self._bus.reading(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    async def _command(self, exchange: Exchange[T]) -> T:
        return await self._bus.run(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    def __repr__(self) -> str:
        return f"<AsyncDrive {self.name}>"


class AsyncBroadcast:
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""

    def __init__(self, bus: AsyncRuns, party: Party, operations: Operations) -> None:
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

    async def write(self, parameter: str, value: Value | float, **options: Any) -> None:
        """Write a parameter of all drives; returns when the telegram is sent."""
        exchange = self._verbs.write(parameter, value, options)
        if stored := self._verbs.stored_parameter(parameter, options):
            self._bus.storing(self._party, stored)
        await self._bus.run(self._party, exchange, Rank.COMMAND, self._bus.command(self._party))

    async def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop all motors; overtakes all else on the line, and returns when the telegram is sent."""
        await self._bus.stop(self._party, self._verbs.stop(how))
