"""Forecast of a poll plan before anything runs: the time of each read and of a round, and whether the plan fits.

    plan = Plan(reads=(PollItem(drive=DriveConfig(protocol="vabus", address=1), parameter="481"),))
    forecast(plan).cycle_s

Virtual drives rehearse the plan in virtual time; `drivecomm.virtual.rehearsal` describes how accurate this is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.virtual.forecast_advice import advise
from drivecomm.virtual.rehearsal import LineConditions, Shares, prepared, rehearse_periods, rehearse_round

if TYPE_CHECKING:
    from drivecomm.line import PollPlan
    from drivecomm.virtual.rehearsal import PeriodsResult, RoundResult

FULL = 0.995
"""Largest share of busy time at which a line still recovers from delays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemForecast:
    """One read of a plan on a busy line; all times in seconds.

    seconds: total time of the read. wire_s: its characters on the line. delay_s: the drive's delay until it answers.
    pause_s: pauses that keep the line quiet for it. rest_s: all other time, such as waiting in vain. every_s: actual
    interval when the plan runs with its periods. late_s: largest lateness. missed: number of periods without a read.
    cause: reason why the read fails, else empty.
    """

    drive: str
    parameter: str
    period_s: float
    seconds: float
    wire_s: float
    delay_s: float
    pause_s: float
    rest_s: float
    every_s: float
    late_s: float
    missed: int
    cause: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveForecast:
    """Total times of one drive's reads in a round, in seconds, and their share of the line's time."""

    drive: str
    settings: str
    reads: int
    seconds: float
    wire_s: float
    delay_s: float
    pause_s: float
    rest_s: float
    utilisation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """The forecast of a plan for one line.

    cycle_s: seconds of a round that reads each item once, in the order of the plan. utilisation: share of the line's
    time that the plan needs; above 1 if it needs more than exists. Reads without a period need none. fits: whether all
    periods are kept. room_to_spare: whether the plan also leaves the requested share of the line's time free. advice:
    changes for a plan without that room, and reads that fail.
    """

    port: str
    items: tuple[ItemForecast, ...]
    drives: tuple[DriveForecast, ...]
    cycle_s: float
    utilisation: float
    fits: bool
    room_to_spare: bool
    advice: tuple[str, ...]


def forecast(
    plan: PollPlan, *, guard_s: float = 0.005, reply_delay_s: float | None = None, room: float = 0.05, **facts: Any
) -> Forecast:
    """Return the forecast of a plan for one line, without opening a port.

    guard_s: quiet time after a change of line settings, as in `open_bus`. reply_delay_s: reply delay of drives for
    which the plan gives none; None for that of the virtual drives. room: share of the line's time, from 0 to below 1,
    that the plan must leave free for commands and repetitions. facts: line facts for all drives, as in `open_bus`.
    Raises UsageError for invalid drives, and for a plan with several lines: forecast each `plan.on_line(port)` instead.
    """
    if len(plan.lines) > 1:
        raise UsageError(f"the plan has {len(plan.lines)} lines; forecast each of them, plan.on_line(port)")
    conditions = LineConditions(facts=facts, guard_s=guard_s, reply_delay_s=reply_delay_s, room=room)
    plan = prepared(plan)
    round_ = rehearse_round(plan, conditions)
    course = rehearse_periods(plan, conditions)
    items = _items(plan, round_, course)
    drives = _drives(plan, round_)
    need = sum(drive.utilisation for drive in drives)
    fits = course.busy <= FULL and not any(item.missed for item in items)
    if not all(item.period_s for item in items):
        # Reads without a period fill any line, so the busy time does not show whether the others fit.
        fits = fits and need <= FULL
    # With mixed periods the line settings change less often than in a round, so a full line may still fit.
    utilisation = min(need, 1.0) if fits else need
    room_to_spare = fits and utilisation <= conditions.most
    return Forecast(
        port=plan.lines[0],
        items=items,
        drives=drives,
        cycle_s=sum(item.seconds for item in items),
        utilisation=utilisation,
        fits=fits,
        room_to_spare=room_to_spare,
        advice=tuple(advise(plan, conditions, round_, course, well=room_to_spare)),
    )


def _items(plan: PollPlan, round_: RoundResult, course: PeriodsResult) -> tuple[ItemForecast, ...]:
    return tuple(
        ItemForecast(
            drive=read.drive.name,
            parameter=read.parameter,
            period_s=read.period_s,
            every_s=pace.every_s,
            late_s=pace.late_s,
            missed=pace.missed,
            cause=cause,
            **shares.by_name,
        )
        for read, shares, cause, pace in zip(plan.reads, round_.shares, round_.causes, course.paces, strict=True)
    )


def _drives(plan: PollPlan, round_: RoundResult) -> tuple[DriveForecast, ...]:
    found = []
    for drive in plan.drives:
        own = [(read, shares) for read, shares in zip(plan.reads, round_.shares, strict=True) if read.drive == drive]
        found.append(
            DriveForecast(
                drive=drive.name,
                settings=str(round_.settings[drive]),
                reads=len(own),
                utilisation=sum(shares.seconds / read.period_s for read, shares in own if read.period_s),
                **sum((shares for _, shares in own), Shares()).by_name,
            )
        )
    return tuple(found)
