"""Main figures of the project: the result of version 0.1, and today's floor, goal and measurement."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from report import table

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from report import Figure

# Row title, result of version 0.1, and the names of its figures.
GOALS = {
    "poll plan, 64 lines x 115200, processor time in times pymodbus asyncio's": (
        "1.64",
        r"processor time in times pymodbus asyncio's, poll plan, 64 lines, 115200",
    ),
    "the same, share of the ideal rate": ("0.907", r"share of ideal, poll plan, 64 lines, 115200"),
    "asyncio bus, a task a line, in times pymodbus asyncio's": (
        "0.98",
        r"processor time in times pymodbus asyncio's, asyncio, 64 lines, 115200",
    ),
    "blocking read with the reply ready, in yardsticks": ("20", r"read with the reply ready in yardsticks.*"),
    **{
        f"one line, {way}, share of the wire with pauses, {baudrate}": (
            before,
            rf"{way} share of ideal, \S+, (?!0 ms).*, {baudrate}",
        )
        for way, baudrate, before in (
            ("blocking", 19200, "0.982-0.993"),
            ("blocking", 115200, "0.955-0.989"),
            ("asyncio", 19200, "0.981-0.990"),
            ("asyncio", 115200, "0.931-0.985"),
        )
    },
    "500 drives on 50 lines, exchanges of those possible": ("0.93", r"share of 50 lines' possible"),
    "the same, of one core": ("0.84", r"of one core for 50 lines"),
    "`bus.drive(model=)` of a loaded model, ms": ("7", r"ms for a drive of a loaded model"),
    "the same, KiB": ("110", r"KiB for a drive of a loaded model"),
    "VLT 3500 at 115200 after `tune` on a drive that needs 1 ms": ("0.36", r"share after tune.*vlt3500.*"),
    "the same, Fuji": ("0.32", r"share after tune.*fuji.*"),
}


def goals(figures: Sequence[Figure], wanted: Collection[str] = ()) -> str:
    """Return a section with a row for each goal that is wanted or has figures."""
    rows = []
    for goal, (before, _) in GOALS.items():
        of = belonging(goal, figures)
        if of or goal in wanted:
            rows.append(_row(goal, before, of))
    return "\n".join(["## Goals", "", *table(("", "0.1", "floor", "goal", "measured", ""), rows), ""])


def belonging(goal: str, figures: Iterable[Figure]) -> list[Figure]:
    """Return the figures that belong to a goal."""
    _, names = GOALS[goal]
    return [figure for figure in figures if re.fullmatch(names, figure.name)]


def unjudged(figures: Sequence[Figure]) -> list[str]:
    """Return the goals without a figure, or with void figures only."""
    of = {goal: belonging(goal, figures) for goal in GOALS}
    return [goal for goal, found in of.items() if not found or any(figure.disturbed for figure in found)]


def _row(goal: str, before: str, figures: Sequence[Figure]) -> Sequence[str]:
    if not figures:
        return (goal, before, "", "", "", "not measured")
    worst = max(figures, key=lambda figure: figure.rank)
    marks = (_range(f"{getattr(one, mark):.4g}" for one in figures) for mark in ("floor", "promise", "value"))
    return (goal, before, *marks, worst.verdict)


def _range(values: Iterable[str]) -> str:
    ordered = sorted(set(values), key=float)
    return ordered[0] if len(ordered) == 1 else f"{ordered[0]}-{ordered[-1]}"
