"""Rehearsal of a poll plan by virtual drives with the same addresses and line facts, in virtual time.

The result is exact for these drives: their telegrams have the lengths of the real ones, and the link waits as on a real
line. If a real drive answers earlier or later than its virtual double, give its reply delay.
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Any

from drivecomm.bus import open_bus
from drivecomm.errors import DriveCommError, UsageError, in_one_line
from drivecomm.line import FIRST_ROUND_S, STATUS, PollBlock, in_blocks, poll_bus
from drivecomm.link import CAREFUL_S
from drivecomm.models import load_model
from drivecomm.protocol import LONGEST_DELAY_S, ParameterInfo, installed
from drivecomm.virtual.drive_keys import virtual_drive
from drivecomm.virtual.line import VirtualLine
from drivecomm.virtual.plant_drive import PlantDrive
from drivecomm.virtual.rehearsed_drive import RehearsedDrive

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import Bus
    from drivecomm.line import PollItem, PollPlan, PollResult
    from drivecomm.link import TraceEvent
    from drivecomm.protocol import DriveConfig, LineSettings, Model

_ROUNDS = 3
"""Number of rounds to rehearse; only the last one counts, because the first one begins on an idle line."""

_MOST_READS = 4000
"""Largest number of reads in a rehearsal of periods, however long the longest period is."""

_PERIODS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class LineConditions:
    """Conditions on a line in addition to the facts of its drives.

    facts: line facts for all drives, as in `open_bus`. guard_s: quiet time after a change of line settings.
    reply_delay_s: reply delay of drives for which the plan gives none; None for that of the virtual drives. room: share
    of the line's time that a plan must leave free for commands and repetitions.
    """

    facts: Mapping[str, Any]
    guard_s: float = 0.005
    reply_delay_s: float | None = None
    room: float = 0.05

    def __post_init__(self) -> None:
        if not 0 <= self.room < 1:
            raise UsageError(f"invalid room of {self.room:.0%}; give a share of the line's time from 0% to below 100%")
        for name, seconds in (("guard time", self.guard_s), ("reply delay", self.reply_delay_s)):
            if seconds is not None and not 0 <= seconds < LONGEST_DELAY_S:
                raise UsageError(f"a {name} of {seconds} s is not between 0 and {LONGEST_DELAY_S:g}")

    @property
    def most(self) -> float:
        """The largest share of the line's time that a plan may need."""
        return 1 - self.room


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """The time that an item takes, divided by cause, in seconds.

    wire_s: characters on the line, requests and replies. delay_s: the drive's delay from a request to its reply.
    pause_s: silence for the protocol's pauses and for the guard time after new line settings, before this item and
    inside it. rest_s: all other time, such as waiting for an answer that does not come.
    """

    wire_s: float = 0.0
    delay_s: float = 0.0
    pause_s: float = 0.0
    rest_s: float = 0.0

    @property
    def seconds(self) -> float:
        """The total time in seconds."""
        return self.wire_s + self.delay_s + self.pause_s + self.rest_s

    @property
    def by_name(self) -> dict[str, float]:
        """The total and its parts, under the names that a forecast uses."""
        return {"seconds": self.seconds, **asdict(self)}

    def of(self, number: int) -> Shares:
        """Return the part of each item if one telegram reads this number of items."""
        return Shares(**{name: share / number for name, share in asdict(self).items()})

    def __add__(self, other: Shares) -> Shares:
        return Shares(**{name: share + getattr(other, name) for name, share in asdict(self).items()})


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundResult:
    """One round of a plan on a busy line.

    shares: share of each read, in order. causes: reason why each read fails, empty if it succeeds. settings: settings
    of each drive.
    """

    shares: Sequence[Shares]
    causes: Sequence[str]
    settings: Mapping[DriveConfig, LineSettings]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadPace:
    """The regularity of a read. every_s: actual interval. late_s: largest lateness.

    missed: number of periods without a read.
    """

    every_s: float
    late_s: float
    missed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodsResult:
    """The regularity of all reads of a plan, and the share of the time in which the line is busy.

    Reads without a period do not count as busy; they use the free time.
    """

    paces: Sequence[ReadPace]
    busy: float


def rehearse_round(plan: PollPlan, conditions: LineConditions) -> RoundResult:
    """Carry out the reads of a plan one after the other, and measure a round in the steady state."""
    ledger = _Ledger()
    with _line(plan, conditions, ledger.events.append) as bus:
        items = plan.items(lambda drive: RehearsedDrive(drive.build(bus.drive)))
        settings = {read.drive: item.drive.facts.settings for item, read in zip(items, plan.reads, strict=True)}
        for _ in range(_ROUNDS):
            by_item: dict[int, tuple[Shares, str]] = {}
            for turn in in_blocks(items):
                together = turn.items if isinstance(turn, PollBlock) else (turn,)
                found = _causes(turn)
                used = ledger.close(turn.drive.facts.settings, bus.now()).of(len(together))
                by_item |= {id(item): (used, cause) for item, cause in zip(together, found, strict=True)}
    ordered = [by_item[id(item)] for item in items]
    return RoundResult(shares=[used for used, _ in ordered], causes=[cause for _, cause in ordered], settings=settings)


def _causes(turn: PollItem[RehearsedDrive] | PollBlock[RehearsedDrive]) -> list[str]:
    """Read an item, or those of a block; return the reason why each read fails, empty if it succeeds."""
    try:
        if isinstance(turn, PollBlock):
            came = turn.drive.read_many(turn.parameters)
            return [in_one_line(each) if isinstance(each, DriveCommError) else "" for each in came]
        turn.drive.polled(turn.parameter, **turn.options)
    except DriveCommError as error:
        return [in_one_line(error)] * (len(turn.items) if isinstance(turn, PollBlock) else 1)
    return [""]


def rehearse_periods(plan: PollPlan, conditions: LineConditions) -> PeriodsResult:
    """Carry out a plan with its periods, for six times the longest; return the regularity of each read."""
    longest = max(read.period_s for read in plan.reads) or 1.0
    asked: list[list[float]] = [[] for _ in plan.reads]
    late = [0.0] * len(plan.reads)
    missed = [0] * len(plan.reads)
    counted: list[tuple[float, float]] = []
    settled: float | None = None
    for number, result in islice(_carried_out(plan, conditions, _PERIODS * longest), _MOST_READS):
        began = result.due_s + result.late_s
        asked[number].append(began)
        if settled is None:
            # Leave out the beginning, when all reads are due at the same time.
            settled = began + min(longest, FIRST_ROUND_S)
        if began >= settled:
            late[number] = max(late[number], result.late_s)
            missed[number] += result.missed
            if not counted or counted[-1][0] != began:
                # Count the time of a telegram that reads several items once.
                counted.append((began, result.took_s if plan.reads[number].period_s else 0.0))
    paces = [
        ReadPace(
            every_s=_interval(times) if lost or worst >= read.period_s else read.period_s, late_s=worst, missed=lost
        )
        for read, times, worst, lost in zip(plan.reads, asked, late, missed, strict=True)
    ]
    return PeriodsResult(paces=paces, busy=_busy(counted))


def _busy(reads: Sequence[tuple[float, float]]) -> float:
    """Return the share of the time that reads take. reads: the start and the duration of each."""
    if len(reads) < 2:
        return 0.0
    return sum(took_s for _, took_s in reads[:-1]) / (reads[-1][0] - reads[0][0])


def prepared(plan: PollPlan) -> PollPlan:
    """Return a plan with its models loaded, so that each file is read once. Raises UsageError for an invalid model."""

    def loaded(drive: DriveConfig) -> DriveConfig:
        model = drive.options.get("model")
        if model is None:
            return drive
        return drive.with_options(model=load_model(installed[drive.protocol].package, drive.protocol, model))

    return plan.with_drives(loaded)


def _carried_out(plan: PollPlan, conditions: LineConditions, duration_s: float) -> Iterator[tuple[int, PollResult]]:
    """Yield the results, each with the position of its read in the plan."""
    with _line(plan, conditions, None) as bus:
        items = plan.items(lambda drive: RehearsedDrive(drive.build(bus.drive)))
        places = {item: place for place, item in enumerate(items)}
        # Just after opening, and at the first exchange with each drive, the link listens longer to every reply.
        # A plan that runs for days does not show this, so leave that time out.
        bus.sleep_until(bus.now() + CAREFUL_S)
        for item in items:
            _causes(item)
        for result in poll_bus(items, duration_s):
            yield places[result.item], result


def _line(plan: PollPlan, conditions: LineConditions, trace: Callable[[TraceEvent], None] | None) -> Bus:
    line = VirtualLine([_double(plan, drive, conditions) for drive in plan.drives])
    return open_bus(line.port, guard_s=conditions.guard_s, trace=trace, **conditions.facts)


def _double(plan: PollPlan, drive: DriveConfig, conditions: LineConditions) -> PlantDrive:
    """Return a virtual drive that has all parameters the plan reads, without the faults and values of a plant."""
    model = _model(drive, [read for read in plan.reads if read.drive == drive])
    delay_s = conditions.reply_delay_s if drive.reply_delay_s is None else drive.reply_delay_s
    return PlantDrive(
        replace(drive, reply_delay_s=delay_s, needs_pause_s=0.0, values={}), model, for_all=conditions.facts
    )


def _model(drive: DriveConfig, reads: Sequence[PollItem[DriveConfig]]) -> Model:
    """Return the drive's model plus the parameters that it lacks; otherwise the drive would refuse these reads."""
    plugin = installed[drive.protocol]
    model = load_model(plugin.package, drive.protocol, drive.options.get("model") or plugin.default_model)
    readable = [info for info in model.parameters.values() if "r" in info.access]
    added: dict[str, ParameterInfo] = {}
    for read in reads:
        if read.parameter == STATUS:
            continue
        address = read.parameter.partition("[")[0]
        if readable and model.find(read.parameter) is None and model.find(address) is None:
            given = read.options.get("type")
            usual = Counter(info.type for info in readable).most_common(1)[0][0]
            type_ = given if isinstance(given, str) and given else usual
            one = ParameterInfo(address=address, name=f"planned_{len(added)}", title=address, type=type_)
            # An invalid address is reported by the read itself.
            with suppress(ValueError, KeyError):
                virtual_drive(drive.protocol, drive.address, model=_with(model, {address: one}))
                added[address] = one
    return _with(model, added)


def _with(model: Model, added: Mapping[str, ParameterInfo]) -> Model:
    return replace(model, parameters={**model.parameters, **added})


class _Ledger:
    """Ledger of the time on a line by the items that use it, from the trace of the bus."""

    def __init__(self) -> None:
        self.events: list[TraceEvent] = []
        self._quiet_s = 0.0

    def close(self, settings: LineSettings, ended_s: float) -> Shares:
        """Return the time of the item that has just ended; bytes still on the wire count for it."""
        wire = delay = pause = rest = 0.0
        at, open_request = self._quiet_s, False
        for event in self.events:
            length = settings.wire_s(len(event.data))
            if event.what == "sent":
                if open_request:
                    rest += event.time - at
                else:
                    pause += event.time - at
                at, open_request = event.time + length, True
            elif event.what == "received":
                delay += event.time - length - at
                at, open_request = event.time, False
            else:
                continue
            wire += length
        self.events.clear()
        rest += max(0.0, ended_s - at)
        self._quiet_s = max(at, ended_s)
        return Shares(wire_s=wire, delay_s=delay, pause_s=pause, rest_s=rest)


def _interval(times: Sequence[float]) -> float:
    return (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 0.0
