"""Durations in the notation of people: 30 min, 2h, "1 d"."""

from __future__ import annotations

import re

_DURATION = re.compile(r"(\d+(?:\.\d+)?) *(s|min|m|h|d|w)", re.ASCII)
_SECONDS = {"s": 1, "m": 60, "min": 60, "h": 3600, "d": 86400, "w": 604800}

UNITS = "s, min, h, d or w"
"""Names of the units, for error messages."""


def seconds_in(text: str) -> float | None:
    """Return the seconds in a duration such as "2h", or None if the text is not a duration."""
    match = _DURATION.fullmatch(text.strip())
    return None if match is None else float(match[1]) * _SECONDS[match[2]]
