"""What a poll plan reads, and what came of it, as data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import is_duration, is_whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from drivecomm.errors import DriveCommError
    from drivecomm.protocol import PollGroup, Reading

ResultQuality: TypeAlias = Literal["good", "uncertain", "stale", "bad"]
"""good, uncertain: as of a `Reading`. stale: the drive gave none now, and this is its last one. bad: there is none."""

FRESH: frozenset[str] = frozenset({"good", "uncertain"})
"""The qualities of a value that the drive has just given."""


class Named(Protocol):
    """What a schedule needs of a drive."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""


if TYPE_CHECKING:
    # Python has defaults of type variables from 3.13 on; every type checker brings this module along.
    import typing_extensions

    D = typing_extensions.TypeVar("D", bound=Named, default=Any)
else:
    D = TypeVar("D", bound=Named)

STATUS = "status"
"""What results call the status of a drive, where it is polled: their value is the state, raw the word."""

STALE_PERIODS = 3
"""How many periods old the last good value may be for a result that is stale and not bad."""

UNHURRIED_S = 1.0
"""How long an item without a period lets those with one go first; how old its value may be when it is stale."""

SHORTEST_S = 1e-6
"""The shortest period; no telegram is as short."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PollItem(Generic[D]):
    """One parameter of one drive that is read again and again.

    period_s: how often; 0 for as often as the line has time left. priority: decides among items that are overdue,
    larger first; each step is worth one second of waiting, so that nothing waits for ever. stale_after_s: how old the
    last good value may be for a result that is stale and not bad; three periods if absent. options: the protocol's own
    for `read`, such as type= or dataset=. name: what results call the drive, its own name if empty.
    """

    drive: D
    parameter: str
    period_s: float = 1.0
    priority: int = 0
    stale_after_s: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.parameter, str):
            raise UsageError(f"invalid parameter {shortened(self.parameter)}; give an address or a name")
        stale_after_s = 0 if self.stale_after_s is None else self.stale_after_s
        for name, seconds in (("period_s", self.period_s), ("stale_after_s", stale_after_s)):
            if not is_duration(seconds):
                raise UsageError(f"{name} of {self.parameter} is {shortened(seconds)}; give seconds, 0 or more")
        if 0 < self.period_s < SHORTEST_S:
            raise UsageError(
                f"period_s of {self.parameter} is {self.period_s}, less than a telegram takes; give {SHORTEST_S} or "
                "more, or 0 for as often as the line has time left"
            )
        if not is_whole(self.priority):
            raise UsageError(f"priority of {self.parameter} is {shortened(self.priority)}; give a whole number")

    @property
    def keeps_s(self) -> float:
        """How old a good value may become before a failure is bad and no longer stale."""
        if self.stale_after_s is not None:
            return self.stale_after_s
        return STALE_PERIODS * self.period_s or UNHURRIED_S


@dataclass(frozen=True, slots=True, eq=False)
class PollBlock(Generic[D]):
    """Items of one drive that are asked together, because one telegram reads them all; equally often and urgent."""

    items: tuple[PollItem[D], ...]

    @property
    def drive(self) -> Any:
        """The drive that is asked, one that has blocks."""
        return self.items[0].drive

    @property
    def parameters(self) -> list[str]:
        """What is read of it."""
        return [item.parameter for item in self.items]

    @property
    def period_s(self) -> float:
        """How often."""
        return self.items[0].period_s

    @property
    def priority(self) -> int:
        """What decides when it is overdue."""
        return self.items[0].priority


def items_of(groups: Iterable[PollGroup], drive: D, name: str = "") -> Iterator[PollItem[D]]:
    """Yield what is polled of a drive by the groups of its plant file. name: what results call it."""
    for group in groups:
        for parameter in group.parameters:
            yield PollItem(
                drive=drive,
                parameter=parameter,
                period_s=group.period_s,
                priority=group.priority,
                options=group.options,
                name=name,
            )


class PollResult(NamedTuple):
    """What came of asking once.

    item: what was asked. drive, parameter: as it names them. reading: the value; with quality "stale" the last good
    one, with "bad" None. cause, error: why there is none now, as a sentence and as the error itself. time_s: when the
    value was taken, or when it was found out that there is none now; in seconds since 1970, on a virtual line since its
    start. A stale value's own time is that of its reading. due_s: when the item was due, on the bus's clock. late_s:
    how much later it was asked. took_s: from asking to the result. missed: periods that passed since the last result
    without being asked, because the line had no time.
    """

    item: PollItem[Any]
    drive: str
    parameter: str
    reading: Reading | None
    cause: str
    error: DriveCommError | None
    time_s: float
    due_s: float
    late_s: float
    took_s: float
    missed: int

    @property
    def quality(self) -> ResultQuality:
        """What the value is worth now: that of its reading, unless the drive gave none."""
        if self.reading is None:
            return "bad"
        return self.reading.quality if self.error is None else "stale"

    @property
    def remark(self) -> str:
        """Why there is no value now, or what is to be known about the one there is."""
        return self.cause or ("" if self.reading is None else self.reading.remark)


def checked(items: Iterable[PollItem[D]], *, cycles: int | None = None) -> Sequence[PollItem[D]]:
    """Return the items of a plan. Raises UsageError for a plan that cannot be carried out."""
    plan = list(items)
    if not plan:
        raise UsageError("a poll plan needs at least one item")
    if cycles is not None and not (is_whole(cycles) and cycles >= 1):
        raise UsageError(f"cycles cannot be {shortened(cycles)}; use 1 or more")
    seen: set[PollItem[D]] = set()
    for item in plan:
        if item in seen:
            raise UsageError(f"the plan has {item.drive.name} {item.parameter} twice")
        seen.add(item)
    return plan
