"""The columns of the table of drives: which there are, and which of them fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from rich.text import Text

from drivecomm.cli.watch.panels import sparkline
from drivecomm.cli.watch.words import ASIDE, head_of, note_of, state_of, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.plant.watching import Board, DriveView, Watcher

    Cell: TypeAlias = Callable[[DriveView], Text]

PADDING = 2
_USUAL_TREND, _LONGEST_TREND = 16, 40
_LEAST_NOTE, _NOTE, _USUAL_NOTE, _LONGEST_NOTE = 6, 18, 34, 60
_LONGEST_NAME = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column. rank: where there is no room, those of the highest rank go first."""

    key: str
    head: str
    width: int
    rank: int
    cell: Cell


def columns_for(watcher: Watcher, board: Board, width: int, shown: str) -> list[Column]:
    """Return the columns that fit into so many characters, at least that of the names.

    shown: the quantity of which there is a trend.
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
        ("trend", _LONGEST_TREND),
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
    head = f"{head_of(shown)} trend"
    columns.append(_column("trend", head, len(head), 12, _cell(watcher, "trend", shown, len(head))))
    for key, counter, rank in (("asked", "requests", 50), ("lost", "timeouts", 46), ("bad", "damaged", 47)):
        columns.append(_column(key, key, 5, rank, partial(_count, counter=counter), right=True))
    columns.append(_column("reply", "reply ms", 8, 48, _reply, right=True))
    columns.append(_column("age", "age s", 5, 45, _age, right=True))
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


def _reply(view: DriveView) -> Text:
    return Text(f"{1000 * view.reply_s:.1f}" if view.reply_s else "")


def _age(view: DriveView) -> Text:
    return Text("" if view.age_s is None else f"{view.age_s:.0f}")


def _width(columns: Sequence[Column]) -> int:
    return sum(column.width + PADDING for column in columns)
