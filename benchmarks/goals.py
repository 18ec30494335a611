"""The figures that the project is known by: what 0.1 reached, and today's floor, goal and measurement beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from report import table

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from report import Figure

POLL_TIME = "poll plan, 64 lines x 115200, processor time in times pymodbus asyncio's"
POLL_SHARE = "the same, share of the ideal rate"
TASKS_TIME = "asyncio bus, a task a line, in times pymodbus asyncio's"
READY_READ = "blocking read with the reply ready, in yardsticks"
PLANT_SHARE = "500 drives on 50 lines, exchanges of those possible"
PLANT_CORE = "the same, of one core"
MODEL_TIME = "`bus.drive(model=)` of a loaded model, ms"
MODEL_MEMORY = "the same, KiB"
TUNED = "{} at 115200 after `tune`, share of the bare wire"
_ONE_LINE = "one line, {}, share of the wire with pauses, {}"
_BEFORE = {
    POLL_TIME: "1.64",
    POLL_SHARE: "0.907",
    TASKS_TIME: "0.98",
    READY_READ: "20",
    _ONE_LINE.format("blocking", 19200): "0.982-0.993",
    _ONE_LINE.format("blocking", 115200): "0.955-0.989",
    _ONE_LINE.format("asyncio", 19200): "0.981-0.990",
    _ONE_LINE.format("asyncio", 115200): "0.931-0.985",
    PLANT_SHARE: "0.93",
    PLANT_CORE: "0.84",
    MODEL_TIME: "7",
    MODEL_MEMORY: "110",
    TUNED.format("vlt3500"): "0.36",
    TUNED.format("fuji"): "0.32",
}


def one_line(way: str, baudrate: int) -> str:
    """Return the goal that a share of one line's wire belongs to; none at other baud rates."""
    name = _ONE_LINE.format(way, baudrate)
    return name if name in _BEFORE else ""


def unjudged(figures: Sequence[Figure]) -> list[str]:
    """Return the goals for which nothing was measured, or what was measured is void."""
    judged = {figure.goal for figure in figures} - {figure.goal for figure in figures if figure.disturbed}
    return [goal for goal in _BEFORE if goal not in judged]


def goals(figures: Sequence[Figure], wanted: Collection[str] = ()) -> str:
    """Return a section with a row for each goal that is wanted or that figures belong to."""
    of = {goal: [figure for figure in figures if figure.goal == goal] for goal in _BEFORE}
    rows = [_row(goal, _BEFORE[goal], of[goal]) for goal in _BEFORE if goal in wanted or of[goal]]
    head = ("", "0.1", "floor", "goal", "measured", "")
    return "\n".join(["## Goals", "", *table(head, rows), ""])


def _row(goal: str, before: str, figures: Sequence[Figure]) -> Sequence[str]:
    if not figures:
        return (goal, before, "", "", "", "not measured")
    worst = max(figures, key=lambda figure: figure.rank)
    marks = (_range(f"{getattr(one, mark):.4g}" for one in figures) for mark in ("floor", "promise", "value"))
    return (goal, before, *marks, worst.verdict)


def _range(values: Iterable[str]) -> str:
    ordered = sorted(set(values), key=float)
    return ordered[0] if len(ordered) == 1 else f"{ordered[0]}-{ordered[-1]}"
