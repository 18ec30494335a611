"""Contents of a plot, made from the rows of a log. No I/O, independent of a plotting library."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan, nan
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import UsageError
from drivecomm.line import STATUS
from drivecomm.plant import SpanOutline

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence
    from datetime import datetime

    from drivecomm.plant.value_log import LogRow

SILENT = "no answer"
FAULT = "fault"

MOST_POINTS = 4000
"""Limit of points in a curve; more points cannot be distinguished in a picture."""


class StateSpan(NamedTuple):
    """Time span in which a drive was in one state: running, ready, fault, no answer. text: fault text."""

    drive: str
    state: str
    begin: datetime
    end: datetime
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """Curve of one quantity of one drive. values: NaN where the drive gave no value."""

    drive: str
    name: str
    unit: str
    times: list[datetime] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Name of the curve in the legend."""
        return f"{self.drive} {self.name.replace('_', ' ')}"

    @property
    def numbers(self) -> list[float]:
        """Values without the gaps."""
        return [value for value in self.values if not isnan(value)]

    @property
    def gaps(self) -> int:
        """Number of gaps in the values, including a gap at the end."""
        ends = zip([nan, *self.values], self.values, strict=False)
        return sum(isnan(value) and not isnan(before) for before, value in ends)

    def thinned(self, most: int = MOST_POINTS) -> Curve:
        """Return the curve with fewer points, but with all extremes and with unchanged ends of gaps."""
        if len(self.values) <= most:
            return self
        size = -(-len(self.values) * SpanOutline.POINTS // most)
        kept = [place for first in range(0, len(self.values), size) for place in self._standing_out(first, size)]
        return Curve(
            drive=self.drive,
            name=self.name,
            unit=self.unit,
            times=[self.times[place] for place in kept],
            values=[self.values[place] for place in kept],
        )

    def _standing_out(self, first: int, size: int) -> list[int]:
        outline: SpanOutline[int] = SpanOutline()
        for place in range(first, min(first + size, len(self.values))):
            value = self.values[place]
            outline.add(place, None if isnan(value) else value)
        return outline.kept()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotContents:
    """Contents of a plot. panels: curves by their unit, in the order of their first rows."""

    panels: dict[str, list[Curve]]
    states: list[StateSpan]

    @property
    def faults(self) -> list[StateSpan]:
        """Time spans in which a drive had a fault."""
        return [each for each in self.states if each.state == FAULT]

    @property
    def curves(self) -> list[Curve]:
        """All curves."""
        return [curve for panel in self.panels.values() for curve in panel]

    @property
    def drives(self) -> list[str]:
        """Drives with a state, in the order of their first rows."""
        return list(dict.fromkeys(each.drive for each in self.states))


def picture_of(rows: Iterable[LogRow], *, drives: Collection[str] = (), names: Collection[str] = ()) -> PlotContents:
    """Return the contents of a plot of these rows.

    drives, names: limit the plot to these; empty for all. The states of a drive are shown independent of names. Raises
    UsageError if nothing is left to show, and for a drive or a name that the rows do not have.
    """
    curves: dict[tuple[str, str, str], Curve] = {}
    units: dict[tuple[str, str], str] = {}
    states: dict[str, list[StateSpan]] = {}
    known_drives: dict[str, None] = {}
    known_names: dict[str, None] = {}
    for row in rows:
        known_drives[row.drive] = known_names[row.name] = None
        if drives and row.drive not in drives:
            continue
        if row.name == STATUS:
            _take_state(states.setdefault(row.drive, []), row)
        elif not names or row.name in names:
            _take_value(curves, units, row)
    _check("drive", drives, known_drives)
    _check("name", names, known_names)
    panels: dict[str, list[Curve]] = {}
    for curve in curves.values():
        if curve.numbers:
            panels.setdefault(curve.unit, []).append(curve)
    if not panels and not any(states.values()):
        raise UsageError("the log holds no numbers to plot; see its column quality, and note for why")
    return PlotContents(panels=panels, states=[each for of_drive in states.values() for each in of_drive])


def _take_value(curves: dict[tuple[str, str, str], Curve], units: dict[tuple[str, str], str], row: LogRow) -> None:
    source = (row.drive, row.name)
    number = row.number if row.is_fresh else None
    if number is None:
        # A failed read has no unit, so it becomes a gap in the latest curve of its value.
        if source not in units:
            return
        number, unit = nan, units[source]
    else:
        unit = units[source] = row.unit
    key = (*source, unit)
    curve = curves.setdefault(key, Curve(drive=row.drive, name=row.name, unit=unit))
    curve.times.append(row.time)
    curve.values.append(number)


def _take_state(states: list[StateSpan], row: LogRow) -> None:
    state = row.value.replace("_", " ") if row.is_fresh else SILENT
    text = row.text if row.is_fresh else row.note
    if states:
        latest = states[-1]
        # A stale row repeats the time of the row before it.
        states[-1] = latest._replace(end=max(latest.end, row.time))
        if (latest.state, latest.text) == (state, text) or latest.state == state == SILENT:
            return
    states.append(StateSpan(row.drive, state, row.time, row.time, text))


def _check(what: str, wanted: Iterable[str], known: Iterable[str]) -> None:
    there: Sequence[str] = list(known)
    for name in wanted:
        if name not in there:
            raise UsageError(f"the log has no {what} {name!r}; it has {', '.join(there) or 'none'}")
