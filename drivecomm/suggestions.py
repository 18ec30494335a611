"""What was probably meant by a name that nobody knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_LONGEST = 100
"""Longer words are no names, and comparing them takes time that grows with the square of their length."""


def closest(name: object, known: Iterable[str]) -> str:
    """Return the known name that is most like this one, whatever its case; nothing where none is."""
    if not isinstance(name, str) or not 0 < len(name) <= _LONGEST:
        return ""
    from difflib import get_close_matches  # noqa: PLC0415 - only who has made a mistake needs it

    by_folded = {each.casefold(): each for each in sorted(known, reverse=True)}
    found = get_close_matches(name.casefold(), sorted(by_folded), n=1)
    return by_folded[found[0]] if found else ""


def near(name: object, known: Iterable[str]) -> str:
    """Return a question that names what was perhaps meant, nothing where no known name is like this one."""
    found = closest(name, known)
    return f"is {found} meant?" if found else ""


def meant(name: object, known: Iterable[str], listed: str) -> str:
    """Return what was perhaps meant, as `near` asks it, and all that there is.

    listed: the words before the names, which end the sentence, such as "it has".
    """
    names = list(known)
    there = f"{listed} {', '.join(names) or 'none'}"
    question = near(name, names)
    return f"{question} {there[0].upper()}{there[1:]}" if question else there


def shortened(name: object) -> str:
    """Return a name as a message shows it, in quotes; a very long one is cut."""
    try:
        text = repr(name)
    except ValueError:
        # Python writes no whole number of more than 4300 digits.
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
