"""The course of one quantity in few points, of which none that stands out is missing. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.polling import ResultQuality
    from drivecomm.protocol import Value


class Point(NamedTuple):
    """A value at a time, in seconds since 1970; None where there was none."""

    time_s: float
    value: Value | None
    quality: ResultQuality


@dataclass(slots=True)
class _Bucket:
    """What stands out in one stretch of time: the lowest and the highest, where a gap begins, changes of a text."""

    lowest: Point | None = None
    highest: Point | None = None
    gap: Point | None = None
    changes: list[Point] = field(default_factory=list)

    def points(self) -> list[Point]:
        each = (self.lowest, self.highest, self.gap, *self.changes)
        return sorted({point for point in each if point is not None}, key=lambda point: point.time_s)


def thinned(points: Iterable[Point], from_s: float, to_s: float, most: int) -> Iterator[Point]:
    """Yield some `most` points of these in the order of time, each once.

    Of each stretch of time the lowest and the highest number, and where a gap begins; of texts, such as a drive's
    state, the first and the last change.
    """
    width = max(to_s - from_s, 0.001) / max(1, most // 2)
    buckets: dict[int, _Bucket] = {}
    latest: object = ...
    for point in points:
        bucket = buckets.setdefault(int((point.time_s - from_s) / width), _Bucket())
        value = point.value
        if value is None:
            bucket.gap = bucket.gap or point
        elif isinstance(value, str):
            if value != latest:
                bucket.changes[1:] = [*bucket.changes[1:1], point] if bucket.changes else []
                bucket.changes = bucket.changes or [point]
        else:
            if bucket.lowest is None or value < bucket.lowest.value:  # type: ignore[operator]
                bucket.lowest = point
            if bucket.highest is None or value > bucket.highest.value:  # type: ignore[operator]
                bucket.highest = point
        latest = value
    for number in sorted(buckets):
        yield from buckets[number].points()
