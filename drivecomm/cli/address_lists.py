"""Addresses as the command line writes them: `1-31` or `1,5,7-9`."""

from __future__ import annotations

from drivecomm.errors import UsageError


def addresses_of(text: str) -> list[int]:
    """Return the addresses in order. Raises UsageError."""
    chosen: list[int] = []
    for part in text.split(","):
        first, dash, last = (word.strip() for word in part.partition("-"))
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise UsageError(f"{text!r} are no addresses; write them as 1-31 or 1,5,7-9")
        chosen += range(int(first), int(last or first) + 1)
    return chosen
