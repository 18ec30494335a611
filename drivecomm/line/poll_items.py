"""Items and results of a poll plan, as data."""

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
"""Quality of a poll result.

good, uncertain: the quality of its `Reading`. stale: the drive gave no value now, and this is its last good one. bad:
there is no value.
"""

FRESH: frozenset[str] = frozenset({"good", "uncertain"})
"""Qualities of a value that the drive has just given."""


class NamedDrive(Protocol):
    """A drive, as far as a schedule needs it."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""


if TYPE_CHECKING:
    # The standard library has defaults of type variables only from Python 3.13; type checkers bring this module along.
    import typing_extensions

    D = typing_extensions.TypeVar("D", bound=NamedDrive, default=Any)
else:
    D = TypeVar("D", bound=NamedDrive)

STATUS = "status"
"""Parameter name of a drive's status in poll items and results: the value is the state, raw the status word."""

STALE_PERIODS = 3
"""Maximum age of the last good value, in periods, for a result that is stale and not bad."""

UNHURRIED_S = 1.0
"""Seconds that an item without a period lets items with one go first; also the maximum age of its stale value."""

SHORTEST_S = 1e-6
"""Shortest period in seconds; every telegram takes longer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PollItem(Generic[D]):
    """One parameter of one drive that is read repeatedly.

    period_s: seconds between reads; 0 to read as often as the line has time left. priority: order among overdue items,
    larger first; each step is worth one second of waiting, so that every item gets its turn. stale_after_s: maximum age
    in seconds of the last good value for a result that is stale and not bad; three periods if absent. options: the
    protocol's own options for `read`, such as type= or dataset=. name: name of the drive in results; its own name if
    empty.
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
        """Maximum age of a good value in seconds, after which a failure is bad and no longer stale."""
        if self.stale_after_s is not None:
            return self.stale_after_s
        return STALE_PERIODS * self.period_s or UNHURRIED_S


@dataclass(frozen=True, slots=True, eq=False)
class PollBlock(Generic[D]):
    """Items of one drive with the same period and priority, which one telegram reads together."""

    items: tuple[PollItem[D], ...]

    @property
    def drive(self) -> Any:
        """The drive to read, which has blocks."""
        return self.items[0].drive

    @property
    def parameters(self) -> list[str]:
        """The parameters to read."""
        return [item.parameter for item in self.items]

    @property
    def period_s(self) -> float:
        """Seconds between reads."""
        return self.items[0].period_s

    @property
    def priority(self) -> int:
        """Order among overdue items, larger first."""
        return self.items[0].priority


def items_of(groups: Iterable[PollGroup], drive: D, name: str = "") -> Iterator[PollItem[D]]:
    """Yield the poll items of a drive from the poll groups of its plant file. name: name of the drive in results."""
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
    """Result of one read.

    item: the item that was read. drive, parameter: their names in the item. reading: the value; the last good one if
    the quality is "stale", None if it is "bad". cause, error: why there is no present value, as a sentence and as the
    error itself. time_s: when the value was taken, or when the read failed; in seconds since 1970, on a virtual line
    since its start. A stale value's own time is that of its reading. due_s: when the item was due, on the bus's clock.
    late_s: seconds between due_s and the request. took_s: seconds from the request to the result. missed: periods since
    the last result that were skipped, because the line had no time.
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
        """Quality of the value: that of its reading, unless the drive gave none now."""
        if self.reading is None:
            return "bad"
        return self.reading.quality if self.error is None else "stale"

    @property
    def remark(self) -> str:
        """Why there is no present value, or the remark of its reading."""
        return self.cause or ("" if self.reading is None else self.reading.remark)


def checked(items: Iterable[PollItem[D]], *, cycles: int | None = None) -> Sequence[PollItem[D]]:
    """Return the items of a plan. Raises UsageError if the plan cannot be carried out."""
    plan = list(items)
    if not plan:
        raise UsageError("a poll plan needs at least one item")
    if cycles is not None and not (is_whole(cycles) and cycles >= 1):
        raise UsageError(f"invalid cycles = {shortened(cycles)}; use 1 or more")
    seen: set[PollItem[D]] = set()
    for item in plan:
        if item in seen:
            raise UsageError(f"the plan has {item.drive.name} {item.parameter} twice")
        seen.add(item)
    return plan
