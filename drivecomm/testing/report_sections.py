"""A report put in order for people: by theme, and in each theme by what is checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.testing.report import Report, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One thing that is checked, on however many vectors or models. failed: those on which it does not hold."""

    kind: str
    meaning: str
    number: int
    failed: tuple[Verdict, ...]
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """What belongs together, such as the contract, the vectors of a file, or one model."""

    title: str
    rows: tuple[Row, ...]

    @property
    def number(self) -> int:
        """How many checks there are."""
        return sum(row.number for row in self.rows)

    @property
    def failed(self) -> int:
        """How many of them do not hold."""
        return sum(len(row.failed) for row in self.rows)


def sections_of(report: Report) -> list[Section]:
    """Return a report by theme, in the order in which it was made."""
    themes: dict[str, list[Verdict]] = {}
    for verdict in report.verdicts:
        themes.setdefault(_theme(verdict.check.name), []).append(verdict)
    return [Section(title=theme, rows=_rows(verdicts)) for theme, verdicts in themes.items()]


def _theme(name: str) -> str:
    parts = name.split("/")
    return parts[1] if len(parts) > 2 else parts[0]


def _rows(verdicts: Iterable[Verdict]) -> tuple[Row, ...]:
    kinds: dict[tuple[str, str], list[Verdict]] = {}
    for verdict in verdicts:
        kinds.setdefault((verdict.check.kind, verdict.check.meaning), []).append(verdict)
    return tuple(
        Row(
            kind=kind,
            meaning=meaning,
            number=len(each),
            failed=tuple(verdict for verdict in each if not verdict.passed),
            seconds=sum(verdict.seconds for verdict in each),
        )
        for (kind, meaning), each in kinds.items()
    )
