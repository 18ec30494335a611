"""A virtual drive of a protocol and its master on one virtual line, with an ear on the drive's own door."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.bus import open_bus
from drivecomm.protocol import Framed, LineSettings, Motor, sort_out
from drivecomm.testing.case import shown
from drivecomm.testing.known_models import known_model
from drivecomm.testing.report import CheckFailure
from drivecomm.virtual import OfDrive, VirtualLine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import Bus, Drive
    from drivecomm.plant import FaultPlan
    from drivecomm.protocol import Codec, Damaged, Model, Protocol, VirtualDrive, VirtualReply

# Longer than any ramp from standstill to the highest frequency, and than the time after which a fault can be reset.
_SETTLED_S = 120.0


class Overheard:
    """A virtual drive behind somebody who listens, and who may keep its answers back or give others.

    heard: the sound telegrams that came to it, in order. said: what it answered to each, None for silence. between:
    told the request and the answer, returns what is sent.
    """

    address = OfDrive[int]()
    settings = OfDrive[LineSettings]()
    gap_s = OfDrive[float]()
    motor = OfDrive[Motor]()

    def __init__(self, drive: VirtualDrive) -> None:
        self.inner = drive
        self.heard: list[Framed] = []
        self.said: list[VirtualReply | None] = []
        self.between: Callable[[Framed, VirtualReply | None], VirtualReply | None] = lambda _, reply: reply

    @property
    def codec(self) -> Codec:
        """What the drive understands."""
        return self.inner.codec

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Let the drive hear, and write down what it heard and said."""
        reply = self.inner.hear(find, now)
        if not isinstance(find, Framed):
            return reply
        self.heard.append(find)
        self.said.append(reply)
        return self.between(find, reply)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what the drive holds."""
        return self.inner.peek(parameter, now)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what the drive holds."""
        self.inner.poke(parameter, raw)

    def trip(self, code: int, now: float) -> None:
        """Make the drive trip."""
        self.inner.trip(code, now)

    @property
    def has_mains(self) -> bool:
        """Whether the drive's mains can be switched; the contract leaves that to the package."""
        return hasattr(self.inner, "power_cycle")

    def power_cycle(self, now: float) -> None:
        """Switch the mains of a drive that has them off and on."""
        self.inner.power_cycle(now)  # type: ignore[attr-defined]


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

    def settle(self) -> None:
        """Let so much time pass that the motor has done what it was told to."""
        self.line.advance(_SETTLED_S)
        # A motor moves when somebody looks.
        self.virtual.motor.advance(self.line.time)

    def nothing_sent(self, why: str) -> None:
        """Raise CheckFailure if the drive has heard anything. why: what should have kept the master silent."""
        if self.virtual.heard:
            raise CheckFailure(f"{why}, and {shown(self.virtual.heard[0].data)} is sent all the same")


@contextmanager
def bench(
    plugin: Protocol,
    model: Model | str = "",
    *,
    addresses: Sequence[int] = (),
    options: Mapping[str, Any] | None = None,
    faults: FaultPlan | None = None,
) -> Iterator[Bench]:
    """Give a bench with a drive of this model at the first of these addresses and others at the rest.

    model: the protocol's own default if empty. addresses: the protocol's first one if absent. options: of all drives.
    """
    known = known_model(plugin, model or plugin.default_model) if isinstance(model, str) else model
    given = dict(options or {})
    facts, chosen = sort_out(plugin, known, given)
    drives = []
    for address in addresses or plugin.addresses[:1]:
        drive = plugin.virtual(address, chosen, known)
        drive.settings, drive.gap_s = facts.settings, facts.gap_s
        drives.append(Overheard(drive))
    line = VirtualLine(drives) if faults is None else VirtualLine(drives, faults=faults)
    with open_bus(line.port) as bus:
        drive_at = bus.drive(plugin.name, drives[0].address, model=known, **given)
        yield Bench(drives[0], tuple(drives[1:]), line, bus, drive_at)


def raise_all(wrong: Sequence[str]) -> None:
    """Raise CheckFailure with the first few of what is wrong, if anything is."""
    if wrong:
        more = f" (and {len(wrong) - 3} more)" if len(wrong) > 3 else ""
        raise CheckFailure("; ".join(wrong[:3]) + more)
