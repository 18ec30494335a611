"""Thinning of a quantity's curve to few points, without losing any that stands out. No I/O, no clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivecomm.plant import SpanOutline

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.line import ResultQuality
    from drivecomm.protocol import Value


class CoursePoint(NamedTuple):
    """A value at a time, in seconds since 1970; None if there was no value."""

    time_s: float
    value: Value | None
    quality: ResultQuality


def thinned(points: Iterable[CoursePoint], from_s: float, to_s: float, most: int) -> Iterator[CoursePoint]:
    """Yield about `most` of these points in the order of time, each once.

    The result has the first and the last point of each period, the lowest and the highest number, and the points where
    gaps begin and end. Of texts, such as a drive's state, only changes count as points. The result exceeds `most` only
    with many gaps.
    """
    width = max(to_s - from_s, 0.001) / max(1, most // SpanOutline.POINTS)
    outlines: dict[int, SpanOutline[CoursePoint]] = {}
    latest: object = ...
    for point in points:
        is_same_text = isinstance(point.value, str) and point.value == latest
        latest = point.value
        if not is_same_text:
            outlines.setdefault(int((point.time_s - from_s) / width), SpanOutline()).add(point, point.value)
    for number in sorted(outlines):
        # If the clock was set back, later points lie between earlier ones.
        yield from sorted(outlines[number].kept(), key=lambda point: point.time_s)
