"""Panels of the watch screen: the table of drives with as many columns as fit, one drive in full, and the events."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from rich.console import Group
from rich.table import Table
from rich.text import Text

from drivecomm.cli.watch.words import (
    ASIDE,
    WARNING,
    at_machine,
    counters_of,
    event_line,
    head_of,
    in_full,
    note_of,
    state_of,
    unit_of,
    value_of,
)
from drivecomm.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.plant.watching import Board, DriveView, Watcher

    Cell: TypeAlias = Callable[[DriveView], Text]

_OUTPUT, _MACHINE = "output_frequency", 14
_NAMES, _VALUES, _RANGE, _GAP = 22, 12, 18, 2
_LEAST_TREND, _LONGEST_TREND = 8, 60

_CHART, _LOWEST_CHART = 24, 5
_SCALE = 8


def drive_panel(view: DriveView, watcher: Watcher, *, shown: str, width: int, height: int) -> Group:
    """Return all values of a drive. shown: quantity of the chart, which is drawn if there is room."""
    left = width - _NAMES - _VALUES - 2 * _GAP
    # If there is little room, the range is dropped first, then the trend.
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
        if len(beside := at_machine(view, name)):
            table.add_row("", beside)
    error = [Text(printable(view.error), style=WARNING)] if view.error else []
    room = height - table.row_count - len(error) - 4
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


def events_panel(board: Board) -> Group:
    """Return the events, the latest first."""
    if not board.events:
        return Group(Text("nothing has changed yet", style=ASIDE))
    return Group(*(event_line(each, board.began_s) for each in board.events))


_STEPS = "▁▂▃▄▅▆▇█"
GAP = " "


def sparkline(values: Sequence[float | None]) -> str:
    """Return one character per value, scaled from 0 (or a lower minimum) to the maximum; a gap for None."""
    there = [value for value in values if value is not None]
    low, high = min([0.0, *there]), max([0.0, *there])
    return "".join(GAP if value is None else _step(value, low, high) for value in values)


def _step(value: float, low: float, high: float) -> str:
    if high == low:
        return _STEPS[0]
    return _STEPS[round((value - low) / (high - low) * (len(_STEPS) - 1))]


def chart(values: Sequence[float | None], height: int) -> list[str]:
    """Return a sparkline of several lines, the highest line first, with the figures of its scale in front."""
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
    """Return the height of a bar in eighths of a line, at least 1 so that the lowest value is visible."""
    share = (value - low) / (high - low) if high > low else 0.0
    return max(1, round(share * height * len(_STEPS)))


def _part(eighths: int | None, line: int) -> str:
    """Return the character of a bar on one line, counted from below."""
    if eighths is None:
        return GAP
    here = min(eighths - line * len(_STEPS), len(_STEPS))
    return _STEPS[here - 1] if here > 0 else " "


PADDING = 2
_USUAL_TREND, _WIDEST_TREND = 16, 40
_LEAST_NOTE, _NOTE, _USUAL_NOTE, _LONGEST_NOTE = 6, 18, 34, 60
_LONGEST_NAME = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """Column of the table. rank: columns with the highest rank are dropped first if there is no room."""

    key: str
    head: str
    width: int
    rank: int
    cell: Cell


def columns_for(watcher: Watcher, board: Board, width: int, shown: str) -> list[Column]:
    """Return the columns that fit into this width, at least the column of names.

    shown: quantity of the trend.
    """
    columns = _all_columns(watcher, board, shown)
    while len(columns) > 1 and (surplus := _width(columns) - width) > 0:
        last = max(columns, key=lambda column: column.rank)
        columns.remove(last)
        if last.key == "note" and last.width - surplus >= _LEAST_NOTE:
            columns.append(replace(last, width=last.width - surplus))
    spare = width - _width(columns)
    for key, longest in (
        ("trend", _USUAL_TREND),
        ("note", _USUAL_NOTE),
        ("trend", _WIDEST_TREND),
        ("note", _LONGEST_NOTE),
    ):
        for place, column in enumerate(columns):
            if column.key == key:
                grown = max(column.width, min(longest, column.width + spare))
                spare -= grown - column.width
                columns[place] = replace(column, width=grown, cell=_cell(watcher, key, shown, grown))
    return columns


def _all_columns(watcher: Watcher, board: Board, shown: str) -> list[Column]:
    views = board.drives
    named = max(len(view.name) for view in views)
    places = max(len(str(view.drive)) for view in views)
    known = [name for name in watcher.names if any(name in view.values for view in views)]
    columns = [_column("drive", "drive", min(_LONGEST_NAME, max(5, named)), 0, lambda view: Text(view.name))]
    if any(view.name != str(view.drive) for view in views):
        columns.append(_column("place", "address", places, 40, lambda view: Text(str(view.drive), style=ASIDE)))
    columns.append(_column("state", "state", 9, 1, state_of))
    for place, name in enumerate(known):
        wide = max(7, len(head_of(name)))
        cell = partial(value_of, name=name)
        columns.append(_column(name, head_of(name), wide, 10 + 5 * place, cell, right=True))
        if name == _OUTPUT and any(view.drive.machine is not None for view in views):
            beside = partial(at_machine, name=name)
            columns.append(_column("machine", "machine", _MACHINE, 13, beside, right=True))
    head = f"{head_of(shown)} trend"
    columns.append(_column("trend", head, len(head), 12, _cell(watcher, "trend", shown, len(head))))
    for key, counter, rank in (("asked", "requests", 50), ("lost", "timeouts", 46), ("bad", "damaged", 47)):
        columns.append(_column(key, key, 5, rank, partial(_count, counter=counter), right=True))
    columns.append(
        _column(
            "reply",
            "reply ms",
            8,
            48,
            lambda view: Text(f"{1000 * view.reply_s:.1f}" if view.reply_s else ""),
            right=True,
        )
    )
    columns.append(
        _column("age", "age s", 5, 45, lambda view: Text("" if view.age_s is None else f"{view.age_s:.0f}"), right=True)
    )
    columns.append(_column("note", "note", _NOTE, 2, note_of))
    return columns


def _cell(watcher: Watcher, key: str, shown: str, width: int) -> Cell:
    if key == "note":
        return note_of
    return lambda view: Text(sparkline(watcher.cells(view.name, shown, width)), style="cyan")


def _column(key: str, head: str, width: int, rank: int, cell: Cell, *, right: bool = False) -> Column:
    if not right:
        return Column(key=key, head=head, width=width, rank=rank, cell=cell)

    def to_the_right(view: DriveView) -> Text:
        text = cell(view)
        text.justify = "right"
        return text

    return Column(key=key, head=head.rjust(width), width=width, rank=rank, cell=to_the_right)


def _count(view: DriveView, counter: str) -> Text:
    return Text(str(view.counters.get(counter, 0)))


def _width(columns: Sequence[Column]) -> int:
    return sum(column.width + PADDING for column in columns)
