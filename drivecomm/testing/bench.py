"""A virtual drive of a protocol and its master on one virtual line, with an ear on the drive's own door."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.bus import open_bus
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.plant import UNDISTURBED, FaultPlan
from drivecomm.protocol import Framed, resolve_options
from drivecomm.testing.checking import CheckFailure, known_model, shown
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

# Longer than any ramp from standstill to the highest frequency, and than the time after which a fault can be reset.
_SETTLED_S = 120.0

# More parameters than any two drives have.
_MOST_STEPS = 4000
_TRIED = 3


class Overheard(DriveProxy):
    """A virtual drive whose telegrams are written down, and whose answers can be kept back or replaced.

    heard: the sound telegrams that came to it, in order. said: what it answered to each, None for silence. between:
    told the request and the answer, returns what is sent.
    """

    def __init__(self, drive: VirtualDrive) -> None:
        super().__init__(drive)
        self.heard: list[Framed] = []
        self.said: list[VirtualReply | None] = []
        self.between: Callable[[Framed, VirtualReply | None], VirtualReply | None] = lambda _, reply: reply

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Let the drive hear, and write down what it heard and said."""
        reply = super().hear(find, now)
        if not isinstance(find, Framed):
            return reply
        self.heard.append(find)
        self.said.append(reply)
        return self.between(find, reply)


class Bench(NamedTuple):
    """A drive, its line, its master. others: further drives on the line."""

    virtual: Overheard
    others: tuple[Overheard, ...]
    line: VirtualLine
    bus: Bus
    drive: Drive

    @property
    def answers_too_late(self) -> bool:
        """Whether the drive answers, and later than the master waits for it."""
        said = self.virtual.said[-1] if self.virtual.said else None
        return said is not None and said.delay_s >= self.drive.facts.timing.reply_timeout_s

    @property
    def place(self) -> tuple[int, LineSettings]:
        """Where the drive is heard; a write may change it."""
        return self.virtual.address, self.virtual.settings

    def write(self, parameter: str, value: Value) -> Reading | None:
        """Write, and store where it cannot be written otherwise; returns what the drive confirms."""
        try:
            return self.drive.write(parameter, value)
        except NotSupported:
            return self.drive.write(parameter, value, store=True)

    def tell_apart(self, model: Model) -> None:
        """Let every number of every drive of the bench that can be set be one of its own, within its range.

        What is right is then told from what is wrong. A number stays as it was where another one would move the drive
        to another place on the line, or is not taken.
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
        """Read the first parameter that the drive tells, and return its address; empty if there is none."""
        for info in model.parameters.values():
            try:
                self.drive.read(info.address)
            except DriveCommError:
                continue
            return info.address
        return ""

    def set_some_reference(self) -> None:
        """Set a reference in a unit that the drive takes."""
        if self.drive.capabilities.reference_percent:
            self.drive.set_reference(percent=40)
        elif self.drive.capabilities.reference_hz:
            self.drive.set_reference(hz=20)

    def settle(self) -> None:
        """Let so much time pass that the motor has done what it was told to."""
        self.line.advance(_SETTLED_S)
        # A motor moves when somebody looks.
        self.virtual.motor.advance(self.line.time)

    def nothing_sent(self, why: str) -> None:
        """Raise CheckFailure if the drive has heard anything. why: what should have kept the master silent."""
        if self.virtual.heard:
            raise CheckFailure(f"{why}, and {shown(self.virtual.heard[0].data)} is sent all the same")


def _held(virtual: VirtualDrive, info: ParameterInfo) -> tuple[int | str, Decimal]:
    """Return the raw form of a number that can be read and set, and stays as it is, and its step; 0 for any other.

    Of a number whose raw form is not the model's nobody knows what would be set.
    """
    if "rw" not in info.access or info.kind == "command" or not isinstance(info.start, Decimal):
        return 0, Decimal(0)
    with suppress(DriveCommError, InvalidOperation):
        held = virtual.peek(info.address, 0.0)
        steps = (info.factor, Decimal(1))
        return held, next((step for step in steps if Decimal(held) * step == info.start), Decimal(0))
    return 0, Decimal(0)


def _candidates(info: ParameterInfo, taken: set[Decimal]) -> Iterator[Decimal]:
    """Yield a few values that a parameter can hold and no other one does, the one nearest to its start first."""
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
    """Give a bench with a drive of this model at the first of these addresses and others at the rest.

    model: the protocol's own default if absent. addresses: the protocol's first one if empty. options: of all drives.
    """
    known = known_model(plugin, plugin.default_model) if model is None else model
    given = dict(options or {})
    facts, chosen = resolve_options(plugin, known, given)
    drives = []
    for address in addresses or plugin.addresses[:1]:
        drive = plugin.virtual(address, chosen, known)
        drive.settings, drive.gap_s = facts.settings, facts.gap_s
        drives.append(Overheard(drive))
    line = VirtualLine(drives, faults=faults)
    with open_bus(line.port) as bus:
        # Of a series that others answer alike, nothing but a name plate shows which it is.
        drive_at = bus.drive(plugin.name, drives[0].address, model=known, confirmed=known.name, **given)
        yield Bench(drives[0], tuple(drives[1:]), line, bus, drive_at)
