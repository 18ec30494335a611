"""The course of one quantity in few points, of which none that stands out is missing. No I/O, no clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivecomm.plant import Outline

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.line import ResultQuality
    from drivecomm.protocol import Value


class Point(NamedTuple):
    """A value at a time, in seconds since 1970; None where there was none."""

    time_s: float
    value: Value | None
    quality: ResultQuality


def thinned(points: Iterable[Point], from_s: float, to_s: float, most: int) -> Iterator[Point]:
    """Yield some `most` points of these in the order of time, each once.

    Of each stretch of time the first and the last point, the lowest and the highest number, and where gaps begin and
    end; of texts, such as a drive's state, only changes count as points. More than `most` only where there are many
    gaps.
    """
    width = max(to_s - from_s, 0.001) / max(1, most // Outline.POINTS)
    outlines: dict[int, Outline[Point]] = {}
    latest: object = ...
    for point in points:
        is_same_text = isinstance(point.value, str) and point.value == latest
        latest = point.value
        if not is_same_text:
            outlines.setdefault(int((point.time_s - from_s) / width), Outline()).add(point, point.value)
    for number in sorted(outlines):
        # A clock that was set back puts later points between earlier ones.
        yield from sorted(outlines[number].kept(), key=lambda point: point.time_s)
