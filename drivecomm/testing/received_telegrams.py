"""Received telegrams by their fields: which ones are meant, and how to say which ones came instead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import fields_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.testing.recording import Received

_MOST_LISTED = 10
_ABSENT = object()


def matches(received: Received, wanted: Mapping[str, Any]) -> bool:
    """Return whether a telegram has these fields with these values."""
    return not _differing(received, wanted)


def closest(received: Sequence[Received], wanted: Mapping[str, Any]) -> str:
    """Return the latest of those telegrams that differ in the fewest fields, and in which."""
    nearest = min(reversed(received), key=lambda each: len(_differing(each, wanted)))
    fields = nearest.fields
    reasons = [
        f"{name} is {fields[name]!r}, not {wanted[name]!r}" if name in fields else f"it has no {name}"
        for name in _differing(nearest, wanted)
    ]
    return f"{fields_text(nearest.telegram.message)} ({'; '.join(reasons)})"


def listing(received: Sequence[Received]) -> str:
    """Return telegrams one a line, the latest ones if they are many."""
    left_out = len(received) - _MOST_LISTED
    head = [f"  ({left_out} earlier ones are left out)"] if left_out > 0 else []
    shown = [f"  {each.time_s:.4f}  {fields_text(each.telegram.message)}" for each in received[-_MOST_LISTED:]]
    return "\n".join([*head, *shown])


def in_words(number: int, wanted: Mapping[str, Any]) -> str:
    """Return how many telegrams of which sort, in words."""
    fields = [f"{name}={value!r}" for name, value in wanted.items() if name != "kind"]
    sort = f"{wanted['kind']} telegram" if "kind" in wanted else "telegram"
    counted = f"no {sort}" if not number else f"{number} {sort}{'s' if number != 1 else ''}"
    return f"{counted} with {', '.join(fields)}" if fields else counted


def _differing(received: Received, wanted: Mapping[str, Any]) -> list[str]:
    fields, message = received.fields, received.telegram.message
    return [
        name
        for name, value in wanted.items()
        # A field that is a tuple or a decimal in Python is a list or a text where it is written down; both will do.
        if fields.get(name, _ABSENT) != value and (name not in fields or getattr(message, name, _ABSENT) != value)
    ]
