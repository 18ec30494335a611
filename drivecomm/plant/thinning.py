"""Thinning of many values to the points that must be drawn, without losing any extreme. No I/O, no clock.

The points are the first, the last, the lowest and the highest of each time span (M4, for charts with one pixel per
span), and the points at which gaps begin and end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Generic, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Value

P = TypeVar("P")


class _Seen(NamedTuple, Generic[P]):
    number: int
    point: P
    value: Value | float | None


class SpanOutline(Generic[P]):
    """Points of one time span, added in order; `kept` returns those to draw."""

    POINTS: ClassVar = 4
    """Number of points kept of a span of numbers without gaps."""
    MOST_GAPS: ClassVar = 3
    """Number of gaps kept besides the last one; without a limit, a value that comes and goes would keep all points."""

    __slots__ = ("_first", "_gaps", "_highest", "_last", "_lowest")

    def __init__(self) -> None:
        self._first: _Seen[P] | None = None
        self._last: _Seen[P] | None = None
        self._lowest: _Seen[P] | None = None
        self._highest: _Seen[P] | None = None
        self._gaps: list[list[_Seen[P]]] = []

    def add(self, point: P, value: Value | float | None) -> None:
        """Add a point. value: None if there was no value, as for a silent drive."""
        before = self._last
        seen = self._last = _Seen(1 if before is None else before.number + 1, point, value)
        if before is None:
            self._first = seen
        if value is None:
            if before is None or before.value is not None:
                # Beyond the limit, the latest gap replaces those between.
                self._gaps[self.MOST_GAPS :] = [[seen] if before is None else [before, seen]]
            return
        if before is not None and before.value is None:
            self._gaps[-1].append(seen)
        if isinstance(value, str):
            return
        if self._lowest is None or value < self._lowest.value:  # type: ignore[operator]
            self._lowest = seen
        if self._highest is None or value > self._highest.value:  # type: ignore[operator]
            self._highest = seen

    def kept(self) -> list[P]:
        """Return the points to draw, in the order in which they were added, each once."""
        found = {seen.number: seen.point for seen in self._standing_out() if seen is not None}
        return [found[number] for number in sorted(found)]

    def _standing_out(self) -> Iterable[_Seen[P] | None]:
        yield from (self._first, self._lowest, self._highest, self._last)
        for gap in self._gaps:
            yield from gap
