"""Advice for a poll plan that does not fit its line, as sentences with figures."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

from drivecomm.virtual.rehearsal import rehearse_round

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.line import PollPlan
    from drivecomm.protocol import DriveConfig
    from drivecomm.virtual.rehearsal import LineConditions, PeriodsResult, RoundResult

_BAUD_RATES = (9600, 19200, 38400, 57600, 115200)
_WORTH_SAYING = 0.02
_MUCH = 0.25


def advise(
    plan: PollPlan, conditions: LineConditions, round_: RoundResult, course: PeriodsResult, *, well: bool
) -> Iterator[str]:
    """Yield recommended changes, the most effective first; for a plan that fits, only the reads that fail."""
    for read, cause in zip(plan.reads, round_.causes, strict=True):
        if cause:
            yield f"{read.drive.name} {read.parameter} cannot be read: {cause}"
    if well:
        return
    need = _need(plan, round_)
    if need > conditions.most:
        yield _longer_periods(plan, need / conditions.most)
        yield _faster_line(plan, conditions, round_)
        yield from _own_line(plan, round_, conditions.most)
    else:
        yield from _late_reads(plan, round_, course)
    yield from _fewer_changes(plan, conditions, round_)
    yield from _what_dominates(plan, round_)


def _need(plan: PollPlan, round_: RoundResult) -> float:
    """Return the share of the line's time that the plan needs."""
    return sum(
        shares.seconds / read.period_s for read, shares in zip(plan.reads, round_.shares, strict=True) if read.period_s
    )


def _longer_periods(plan: PollPlan, times: float) -> str:
    periods = {read.period_s for read in plan.reads if read.period_s}
    if len(periods) == 1:
        return f"a period of {_up(times * periods.pop())} s would fit"
    return f"periods {_up(times)} times as long would fit"


def _faster_line(plan: PollPlan, conditions: LineConditions, round_: RoundResult) -> str:
    need = 0.0
    for baudrate in _BAUD_RATES:
        slower = [drive for drive in plan.drives if round_.settings[drive].baudrate < baudrate]
        if not slower:
            continue
        faster = plan.with_drives(partial(_at_least, baudrate, slower))
        need = _need(faster, rehearse_round(faster, conditions))
        if need <= conditions.most:
            return (
                f"{baudrate} baud for {_names(slower)} would fit, if they can: the plan then needs {need:.0%} of the "
                "line's time"
            )
    if not need:
        return "a faster line is impossible: all drives are at the highest usual baud rate"
    return f"no baud rate is enough: at {_BAUD_RATES[-1]} baud the plan still needs {need:.0%} of the line's time"


def _at_least(baudrate: int, slower: list[DriveConfig], drive: DriveConfig) -> DriveConfig:
    return drive.with_options(baudrate=baudrate) if drive in slower else drive


def _own_line(plan: PollPlan, round_: RoundResult, most: float) -> Iterator[str]:
    """Yield the drives to move to another line: as few as possible, chosen by the time that they need."""
    needs = dict.fromkeys(plan.drives, 0.0)
    for read, shares in zip(plan.reads, round_.shares, strict=True):
        needs[read.drive] += shares.seconds / read.period_s if read.period_s else 0.0
    left, moved = sum(needs.values()), []
    for drive in sorted(needs, key=needs.__getitem__, reverse=True):
        if left <= most:
            break
        left -= needs[drive]
        moved.append(drive)
    taken = sum(needs[drive] for drive in moved)
    if moved and len(moved) < len(needs) and taken <= most:
        own, need = ("its own", "it needs") if len(moved) == 1 else ("their own", "they need")
        yield f"a line of {own} for {_names(moved)} would fit: {need} {taken:.0%} of one, the others {left:.0%}"


def _late_reads(plan: PollPlan, round_: RoundResult, course: PeriodsResult) -> Iterator[str]:
    """Yield a sentence for each read that comes late although the line has enough time."""
    longest = max(shares.seconds for shares in round_.shares)
    for read, pace in zip(plan.reads, course.paces, strict=True):
        if pace.missed:
            yield (
                f"{read.drive.name} {read.parameter} comes up to {_ms(pace.late_s)} late, more than its period of "
                f"{read.period_s:g} s allows: one read takes up to {_ms(longest)}, and others may be due at the same "
                "time; give it a longer period or a higher priority"
            )


def _fewer_changes(plan: PollPlan, conditions: LineConditions, round_: RoundResult) -> Iterator[str]:
    order = [round_.settings[read.drive] for read in plan.reads]
    different = len(set(order))
    if different < 2 or not conditions.guard_s:
        return
    changes = sum(one != other for one, other in pairwise([order[-1], *order]))
    cycle_s = sum(shares.seconds for shares in round_.shares)
    saved_s = (changes - different) * conditions.guard_s
    if saved_s > _WORTH_SAYING * cycle_s:
        yield (
            f"group the drives by line settings: {changes} changes of settings in a round become {different}, "
            f"which saves {_ms(saved_s)} of {_ms(cycle_s)}"
        )
    elif changes * conditions.guard_s > _WORTH_SAYING * cycle_s:
        yield (
            f"the same line settings for all drives would save up to {_ms(changes * conditions.guard_s)} of "
            f"{_ms(cycle_s)} in a round"
        )


def _what_dominates(plan: PollPlan, round_: RoundResult) -> Iterator[str]:
    """Yield a sentence on pauses or reply delays that take much of a round, which a faster line does not reduce."""
    cycle_s = sum(shares.seconds for shares in round_.shares)
    for share, what, remedy in (
        ("pause_s", "pauses take {} of a round, most of them for {}", "see whether it can be tuned"),
        (
            "delay_s",
            "the drives' reply delays take {} of a round, most of them {}",
            "see whether a parameter of the drive makes it answer sooner",
        ),
    ):
        of_drives = dict.fromkeys(plan.drives, 0.0)
        for read, shares in zip(plan.reads, round_.shares, strict=True):
            of_drives[read.drive] += getattr(shares, share)
        if (total := sum(of_drives.values())) > _MUCH * cycle_s:
            most = max(of_drives, key=of_drives.__getitem__)
            yield f"{what.format(f'{total / cycle_s:.0%}', most.name)} ({_ms(of_drives[most])}); {remedy}"


def _names(drives: list[DriveConfig]) -> str:
    return ", ".join(drive.name for drive in drives)


def _ms(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"


def _up(number: float) -> str:
    """Return a number rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(number)) - 1)
    return f"{math.ceil(number / step - 1e-9) * step:g}"
