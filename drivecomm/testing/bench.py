"""Test bench of a protocol: a virtual drive and its master on one virtual line, with all requests recorded."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.bus import open_bus
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.plant import UNDISTURBED, FaultPlan
from drivecomm.protocol import Framed, resolve_options
from drivecomm.testing.checking import CheckFailure, known_model, message_hex
from drivecomm.virtual import DriveProxy, VirtualLine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import Bus, Drive
    from drivecomm.protocol import (
        Damaged,
        LineSettings,
        Model,
        ParameterInfo,
        Protocol,
        Reading,
        Value,
        VirtualDrive,
        VirtualReply,
    )

# Longer than any ramp from standstill to the highest frequency, and than the wait before a fault can be reset.
_SETTLED_S = 120.0

# More than the number of parameters of any two drives.
_MOST_STEPS = 4000
_TRIED = 3


class InterceptedDrive(DriveProxy):
    """A virtual drive that records its telegrams, and whose replies can be dropped or replaced.

    heard: valid telegrams received, in order. said: the drive's reply to each of them, None for silence. between:
    called with the request and the reply; returns the reply that is sent instead.
    """

    def __init__(self, drive: VirtualDrive) -> None:
        super().__init__(drive)
        self.heard: list[Framed] = []
        self.said: list[VirtualReply | None] = []
        self.between: Callable[[Framed, VirtualReply | None], VirtualReply | None] = lambda _, reply: reply

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Pass the telegram to the drive, and record it with the drive's reply."""
        reply = super().hear(find, now)
        if not isinstance(find, Framed):
            return reply
        self.heard.append(find)
        self.said.append(reply)
        return self.between(find, reply)


class Bench(NamedTuple):
    """A virtual drive, its line and its master.

    others: further drives on the line.
    """

    virtual: InterceptedDrive
    others: tuple[InterceptedDrive, ...]
    line: VirtualLine
    bus: Bus
    drive: Drive

    @property
    def answers_too_late(self) -> bool:
        """Whether the drive's last reply came later than the master's reply timeout."""
        said = self.virtual.said[-1] if self.virtual.said else None
        return said is not None and said.delay_s >= self.drive.facts.timing.reply_timeout_s

    @property
    def place(self) -> tuple[int, LineSettings]:
        """Address and line settings at which the drive can be reached; a write may change them."""
        return self.virtual.address, self.virtual.settings

    def write(self, parameter: str, value: Value) -> Reading | None:
        """Write a parameter, with `store=True` if the drive refuses a volatile write; return the confirmed reading."""
        try:
            return self.drive.write(parameter, value)
        except NotSupported:
            return self.drive.write(parameter, value, store=True)

    def set_unique_values(self, model: Model) -> None:
        """Give every settable number of every drive on the bench a unique value within its range.

        Checks can then distinguish right values from wrong ones. A number keeps its value if the drive refuses the new
        one, or if the new one would change the drive's address or line settings.
        """
        taken: set[Decimal] = set()
        for virtual in (self.virtual, *self.others):
            place = virtual.address, virtual.settings
            for info in model.parameters.values():
                held, step = _held(virtual, info)
                for value in _candidates(info, taken) if step else ():
                    with suppress(DriveCommError, ValueError):
                        raw = value / step
                        virtual.poke(info.address, int(raw) if raw == int(raw) else str(raw))
                        if (virtual.address, virtual.settings) == place:
                            taken.add(value)
                            break
                    virtual.poke(info.address, held)

    def read_first(self, model: Model) -> str:
        """Read the first parameter that the drive answers; return its address, or "" if there is none."""
        for info in model.parameters.values():
            try:
                self.drive.read(info.address)
            except DriveCommError:
                continue
            return info.address
        return ""

    def set_some_reference(self) -> None:
        """Set a reference in a unit that the drive supports."""
        if self.drive.capabilities.reference_percent:
            self.drive.set_reference(percent=40)
        elif self.drive.capabilities.reference_hz:
            self.drive.set_reference(hz=20)

    def settle(self) -> None:
        """Advance the time until the motor has carried out its last command."""
        self.line.advance(_SETTLED_S)
        # The motor model only moves when its time is advanced.
        self.virtual.motor.advance(self.line.time)

    def expect_nothing_sent(self, why: str) -> None:
        """Raise CheckFailure if the drive has received anything. why: the reason why the master had to stay silent."""
        if self.virtual.heard:
            raise CheckFailure(f"{why}, and {message_hex(self.virtual.heard[0].data)} is sent all the same")


def _held(virtual: VirtualDrive, info: ParameterInfo) -> tuple[int | str, Decimal]:
    """Return the present raw value of a settable number and its step; the step is 0 for any other parameter.

    The step is also 0 if the drive's raw value does not match the start value of the model: its scale is unknown then.
    """
    if "rw" not in info.access or info.kind == "command" or not isinstance(info.start, Decimal):
        return 0, Decimal(0)
    with suppress(DriveCommError, InvalidOperation):
        held = virtual.peek(info.address, 0.0)
        steps = (info.factor, Decimal(1))
        return held, next((step for step in steps if Decimal(held) * step == info.start), Decimal(0))
    return 0, Decimal(0)


def _candidates(info: ParameterInfo, taken: set[Decimal]) -> Iterator[Decimal]:
    """Yield a few values within the parameter's range that are not taken yet, nearest to its start value first."""
    if info.values:
        yield from (each for each in map(Decimal, info.values) if each != info.start)
        return
    start = info.start if isinstance(info.start, Decimal) else Decimal(0)
    steps = (sign * number for number in range(1, _MOST_STEPS) for sign in (1, -1))
    found = 0
    for value in (start + step * info.factor for step in steps):
        fits = (info.minimum is None or value >= info.minimum) and (info.maximum is None or value <= info.maximum)
        if fits and value > 0 and value not in taken:
            yield value
            found += 1
            if found == _TRIED:
                return


@contextmanager
def bench(
    plugin: Protocol,
    model: Model | None = None,
    *,
    addresses: Sequence[int] = (),
    options: Mapping[str, Any] | None = None,
    faults: FaultPlan = UNDISTURBED,
) -> Iterator[Bench]:
    """Yield a bench with a drive of this model at the first of these addresses, and others at the remaining ones.

    model: the protocol's default model if absent. addresses: the protocol's first address if empty. options: for all
    drives.
    """
    known = known_model(plugin, plugin.default_model) if model is None else model
    given = dict(options or {})
    facts, chosen = resolve_options(plugin, known, given)
    drives = []
    for address in addresses or plugin.addresses[:1]:
        drive = plugin.virtual(address, chosen, known)
        drive.settings, drive.gap_s = facts.settings, facts.gap_s
        drives.append(InterceptedDrive(drive))
    line = VirtualLine(drives, faults=faults)
    with open_bus(line.port) as bus:
        # Series that share one reply format can only be told apart by their name plate, so the model is confirmed here.
        drive_at = bus.drive(plugin.name, drives[0].address, model=known, confirmed=known.name, **given)
        yield Bench(drives[0], tuple(drives[1:]), line, bus, drive_at)
