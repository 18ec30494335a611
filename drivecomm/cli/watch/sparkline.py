"""A course of values as a row of characters."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

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
