"""Values that a master shows: their position in its output, and whether the drive holds them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.judge.process import OutputLine, Run

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:[.,]\d+)?(?![\w]|[.,]\d)")
_UNITLESS = re.compile(r"[-+]?\d+(?:[.,]\d+)?")
_TROUBLE = re.compile(
    r"\b(errors?|fail(ed|ure)?|refus(ed|al)|time[d -]*out|timeouts?|no (reply|answer|response)|exception|illegal|"
    r"invalid|damaged|bad|wrong|nak|retry(ing)?|retries|lost|warning|cannot|unable|denied|busy)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Shown:
    """A value that the master showed, and its time. text: as printed."""

    time_s: float
    text: str
    value: Decimal


def is_trouble(line: OutputLine) -> bool:
    """Whether a line of output reports an error; its numbers are not values then."""
    return line.is_error or _TROUBLE.search(line.text) is not None


def number_in(text: str) -> Decimal | None:
    """Return the first number in a text, or None."""
    found = _UNITLESS.search(text)
    try:
        return Decimal(found[0].replace(",", ".")) if found else None
    except InvalidOperation:
        return None


class Display:
    """Position and unit of a value in a master's output.

    pattern: matches the value in a line: its group `value`, its first group, or the whole match. scale: the displayed
    number for one unit of the physical value. is_raw: whether the raw number is shown instead.
    """

    def __init__(self, pattern: str, scale: Decimal = Decimal(1), *, is_raw: bool = False) -> None:
        self.pattern = re.compile(pattern)
        self.scale = scale
        self.is_raw = is_raw

    def all_in(self, run: Run) -> list[Shown]:
        """Return the values that a run showed; none if it ended with an error."""
        if run.code:
            return []
        return list(self._all_in(line for line in run.lines if not is_trouble(line)))

    def _all_in(self, lines: Iterable[OutputLine]) -> Iterator[Shown]:
        for line in lines:
            for found in self.pattern.finditer(line.text):
                text = _value_of(found)
                if text and (value := number_in(text)) is not None:
                    yield Shown(line.time_s, text, value)

    def shows(self, shown: Shown, held: object) -> bool:
        """Whether the shown number is this value, physical or raw, to the precision of its digits."""
        if not isinstance(held, Decimal | int | float):
            return False
        expected = Decimal(str(held)) * self.scale
        _, point, decimals = shown.text.replace(",", ".").partition(".")
        apart = abs(shown.value - expected)
        if not point:
            # A number without decimals must match an integer value exactly.
            return apart < 1 if expected % 1 else not apart
        # The last digit may be cut or rounded.
        return apart < Decimal(1).scaleb(-len(decimals))


def _value_of(found: re.Match[str]) -> str:
    groups = found.re.groupindex
    if "value" in groups:
        return found["value"] or ""
    return (found[1] if found.re.groups else found[0]) or ""


def learned_display(
    runs: Sequence[Run], physical: Sequence[Decimal], raw: Sequence[int], scale: Decimal | None
) -> Display | None:
    """Return the display of a parameter, learned from two runs with different values; None if nothing fits both.

    physical, raw: the value in each run. scale: as in the task.
    """
    for line in runs[0].lines:
        if is_trouble(line):
            continue
        for match in _NUMBER.finditer(line.text):
            pattern = _around(line.text, match.start(), match.end())
            for display in displays_of(pattern, scale):
                held = raw if display.is_raw else physical
                here = Shown(0.0, match[0], number_in(match[0]) or Decimal(0))
                if display.shows(here, held[0]) and any(
                    display.shows(each, held[1]) for each in display.all_in(runs[1])
                ):
                    return display
    return None


def displays_of(pattern: str, scale: Decimal | None) -> list[Display]:
    """Return the possible displays for a pattern: with the scale, or physical and raw."""
    return [Display(pattern, scale)] if scale else [Display(pattern), Display(pattern, is_raw=True)]


def _around(text: str, begin: int, end: int) -> str:
    """Return a pattern for similar lines, with any number at this position and at the positions of other numbers."""
    number = r"[-+]?\d+(?:[.,]\d+)?"

    def literal(part: str) -> str:
        return re.sub(r"\d+(?:[.,]\d+)?", lambda _: "\0", part)

    def made(part: str) -> str:
        return re.sub(r"(\\ )+", r"\\s+", re.escape(literal(part))).replace(re.escape("\0"), r"\d+(?:[.,]\d+)?")

    return f"^{made(text[:begin])}(?P<value>{number}){made(text[end:])}$"
