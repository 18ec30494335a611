"""What stands below the table: everything of one drive, and what happened; courses of values in characters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from drivecomm.cli.watch.words import (
    ASIDE,
    WARNING,
    counters_of,
    happening_of,
    head_of,
    in_full,
    note_of,
    state_of,
    unit_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.plant.watching import Board, DriveView, Watcher

_NAMES, _VALUES, _RANGE, _GAP = 22, 12, 18, 2
_LEAST_TREND, _LONGEST_TREND = 8, 60

_CHART, _LOWEST_CHART = 24, 5
_SCALE = 8


def drive_panel(view: DriveView, watcher: Watcher, *, shown: str, width: int, height: int) -> Group:
    """Return everything that is known of a drive. shown: the quantity of which there is a chart where it has room."""
    left = width - _NAMES - _VALUES - 2 * _GAP
    # Where there is little room, first the range gives way, and then the trend.
    further = (_RANGE,) if left - _RANGE - _GAP >= _LEAST_TREND else ()
    cells = max(_LEAST_TREND, min(_LONGEST_TREND, left - sum(further) - _GAP * len(further)))
    columns = (_NAMES, _VALUES, cells, *further) if left >= _LEAST_TREND else (_NAMES, width - _NAMES - _GAP)
    table = Table.grid(padding=(0, _GAP, 0, 0))
    for wide in columns:
        table.add_column(width=wide, no_wrap=True)
    for name, value in view.values.items():
        course = watcher.cells(view.name, name, cells)
        there = [number for number in course if number is not None]
        unit = unit_of(value.reading.unit) if value.reading else ""
        span = f"{min(there):g} to {max(there):g} {unit}".rstrip() if there else ""
        cell = (name.replace("_", " "), in_full(value), Text(sparkline(course), style="cyan"), Text(span, ASIDE))
        table.add_row(*cell[: len(columns)])
    error = [Text(view.error, style=WARNING)] if view.error else []
    room = height - len(view.values) - len(error) - 4
    return Group(_heading(view), *error, table, counters_of(view), *_chart(view, watcher, shown, width, room))


def _chart(view: DriveView, watcher: Watcher, shown: str, width: int, room: int) -> list[Text]:
    cells = max(8, width - _SCALE)
    course = watcher.cells(view.name, shown, cells)
    if room < _LOWEST_CHART or all(value is None for value in course):
        return []
    title = Text(f"\n{head_of(shown)}, the last {watcher.trend_s:.0f} s", style=ASIDE)
    return [title, *(Text(line, style="cyan", no_wrap=True) for line in chart(course, min(room, _CHART)))]


def _heading(view: DriveView) -> Text:
    text = Text(view.name, style="bold", no_wrap=True, overflow="ellipsis").append("  ", style="")
    model = str(view.drive.options.get("model", "no model"))
    arms = "armed" if view.drive.armed else "read-only"
    text.append(f"{view.drive} on {view.line}, {model}, {arms}:  ", style="not bold dim")
    text.append_text(state_of(view))
    return text if view.error else text.append("  ").append_text(note_of(view))


def happenings_panel(board: Board) -> Group:
    """Return what happened, the latest first."""
    if not board.happenings:
        return Group(Text("nothing has changed yet", style=ASIDE))
    return Group(*(happening_of(each, board.began_s) for each in board.happenings))


_STEPS = "▁▂▃▄▅▆▇█"
GAP = " "


def sparkline(values: Sequence[float | None]) -> str:
    """Return one character a value, between 0 (or the lowest, if below) and the highest; a gap for None."""
    there = [value for value in values if value is not None]
    low, high = min([0.0, *there]), max([0.0, *there])
    return "".join(GAP if value is None else _step(value, low, high) for value in values)


def _step(value: float, low: float, high: float) -> str:
    if high == low:
        return _STEPS[0]
    return _STEPS[round((value - low) / (high - low) * (len(_STEPS) - 1))]


def chart(values: Sequence[float | None], height: int) -> list[str]:
    """Return the same on so many lines, the highest first, with the figures of its scale before them."""
    there = [value for value in values if value is not None]
    low, high = min([0.0, *there]), max([0.0, *there])
    labels = {0: f"{high:g}", height - 1: f"{low:g}"}
    wide = max(len(label) for label in labels.values())
    parts = [None if value is None else _eighths(value, low, high, height) for value in values]
    return [
        labels.get(line, "").rjust(wide) + " " + "".join(_part(eighths, height - 1 - line) for eighths in parts)
        for line in range(height)
    ]


def _eighths(value: float, low: float, high: float, height: int) -> int:
    """Return how high the bar of a value is, in eighths of a line; the lowest is seen as well."""
    share = (value - low) / (high - low) if high > low else 0.0
    return max(1, round(share * height * len(_STEPS)))


def _part(eighths: int | None, line: int) -> str:
    """Return what is seen of a bar on one line, counted from below."""
    if eighths is None:
        return GAP
    here = min(eighths - line * len(_STEPS), len(_STEPS))
    return _STEPS[here - 1] if here > 0 else " "
