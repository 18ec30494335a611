"""What must be drawn of many values in a stretch of time, so that nothing that stands out is missing. No I/O, no clock.

The first, the last, the lowest and the highest (M4, as charts of one pixel a stretch need them), and where gaps begin
and end.
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


class Outline(Generic[P]):
    """The points of one stretch of time, added in their order; `kept` are those to draw."""

    POINTS: ClassVar = 4
    """Points that a stretch of numbers without gaps keeps."""
    MOST_GAPS: ClassVar = 3
    """Gaps that are kept besides the last one; a value that comes and goes would keep all points otherwise."""

    __slots__ = ("_first", "_gaps", "_highest", "_last", "_lowest")

    def __init__(self) -> None:
        self._first: _Seen[P] | None = None
        self._last: _Seen[P] | None = None
        self._lowest: _Seen[P] | None = None
        self._highest: _Seen[P] | None = None
        self._gaps: list[list[_Seen[P]]] = []

    def add(self, point: P, value: Value | float | None) -> None:
        """Add a point; value: None where there was none, such as of a silent drive."""
        before = self._last
        seen = self._last = _Seen(1 if before is None else before.number + 1, point, value)
        if before is None:
            self._first = seen
        if value is None:
            if before is None or before.value is not None:
                # Beyond the most, the latest gap stands in for those between.
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
        """Return the points to draw, in the order in which they came, each once."""
        found = {seen.number: seen.point for seen in self._standing_out() if seen is not None}
        return [found[number] for number in sorted(found)]

    def _standing_out(self) -> Iterable[_Seen[P] | None]:
        yield from (self._first, self._lowest, self._highest, self._last)
        for gap in self._gaps:
            yield from gap
