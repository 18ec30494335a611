"""What a master shows of a value: where it stands in its output, and whether the drive holds it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from drivecomm.judge.verdicts import fail

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from drivecomm.judge.process import Line, Run

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:[.,]\d+)?(?![\w]|[.,]\d)")
_UNITLESS = re.compile(r"[-+]?\d+(?:[.,]\d+)?")
_TROUBLE = re.compile(
    r"\b(errors?|fail(ed|ure)?|refus(ed|al)|time[d -]*out|timeouts?|no (reply|answer|response)|exception|illegal|"
    r"invalid|damaged|bad|wrong|nak|retry(ing)?|retries|lost|warning|cannot|unable|denied|busy)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Shown:
    """A value that the master showed, and when. text: as it stood there."""

    time_s: float
    text: str
    value: Decimal


def is_trouble(line: Line) -> bool:
    """Whether a line of output tells of an error, so that no number in it is a value."""
    return line.is_error or _TROUBLE.search(line.text) is not None


def number_in(text: str) -> Decimal | None:
    """Return the number that a text is, None where it is none."""
    found = _UNITLESS.search(text)
    try:
        return Decimal(found[0].replace(",", ".")) if found else None
    except InvalidOperation:
        return None


class Display:
    """Where a master shows a value, and in which unit.

    pattern: finds it in a line, in the group `value`, in its first group, or as a whole. scale: what is shown for one
    unit of the physical value.
    """

    def __init__(self, pattern: str, scale: Decimal = Decimal(1)) -> None:
        self.pattern = re.compile(pattern)
        self.scale = scale

    def all_in(self, run: Run) -> list[Shown]:
        """Return the values that a run showed; one that ended with an error showed none at its end."""
        if run.code not in (0, None) and run.code > 0:
            return []
        return list(self._all_in(line for line in run.lines if not is_trouble(line)))

    def _all_in(self, lines: Iterable[Line]) -> Iterator[Shown]:
        for line in lines:
            for found in self.pattern.finditer(line.text):
                text = _value_of(found)
                if text and (value := number_in(text)) is not None:
                    yield Shown(line.time_s, text, value)

    def shows(self, shown: Shown, physical: object) -> bool:
        """Whether what is shown is this physical value, as exactly as its digits tell."""
        if not isinstance(physical, Decimal | int | float):
            return False
        expected = physical_shown(physical, self.scale)
        _, point, decimals = shown.text.replace(",", ".").partition(".")
        apart = abs(shown.value - expected)
        if not point:
            # Whole numbers are shown of whole ones exactly.
            return apart < 1 if expected % 1 else not apart
        # Cut or rounded, both are usual.
        return apart < Decimal(1).scaleb(-len(decimals))


def physical_shown(physical: Decimal | float, scale: Decimal) -> Decimal:
    """Return what is shown for a physical value."""
    return Decimal(str(physical)) * scale


def _value_of(found: re.Match[str]) -> str:
    groups = found.re.groupindex
    if "value" in groups:
        return found["value"] or ""
    return (found[1] if found.re.groups else found[0]) or ""


def learn(
    first: Run, second: Run, held: Sequence[Mapping[str, Decimal]], factors: Mapping[str, Decimal]
) -> dict[str, Display]:
    """Return how a master shows parameters, from two runs between which what they hold was changed.

    held: by parameter, the physical value in each run. factors: the physical value of one raw unit.
    """
    displays: dict[str, Display] = {}
    for parameter, factor in factors.items():
        for scale in dict.fromkeys((Decimal(1), 1 / factor if factor else Decimal(1))):
            pattern = _pattern(first, second, held[0][parameter], held[1][parameter], scale)
            if pattern:
                displays[parameter] = Display(pattern, scale)
                break
    return displays


def _pattern(first: Run, second: Run, one: Decimal, other: Decimal, scale: Decimal) -> str:
    """Return a pattern for lines that differ between the runs as the value does; empty where there are none."""
    plain = Display("(?P<value>.*)", scale)
    for line in first.lines:
        if is_trouble(line):
            continue
        for match in _NUMBER.finditer(line.text):
            shown = Shown(0.0, match[0], number_in(match[0]) or Decimal(0))
            if not plain.shows(shown, one):
                continue
            pattern = _around(line.text, match.start(), match.end())
            again = Display(pattern, scale)
            if any(again.shows(each, other) for each in again.all_in(second)):
                return pattern
    return ""


def _around(text: str, begin: int, end: int) -> str:
    """Return a pattern for lines like this one, with any number in its place, and others where numbers are."""
    number = r"[-+]?\d+(?:[.,]\d+)?"

    def literal(part: str) -> str:
        return re.sub(r"\d+(?:[.,]\d+)?", lambda _: "\0", part)

    def made(part: str) -> str:
        return re.sub(r"(\\ )+", r"\\s+", re.escape(literal(part))).replace(re.escape("\0"), r"\d+(?:[.,]\d+)?")

    return f"^{made(text[:begin])}(?P<value>{number}){made(text[end:])}$"


def wrong_value(shown: Shown, held: object, why: str) -> None:
    """Fail because of a wrong value. why: whose value it is, or what was done to the telegram."""
    fail(f"it believed a wrong value: it shows {shown.text}, the drive holds {held}; {why}")
