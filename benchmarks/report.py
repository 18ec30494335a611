"""Results as tables for people, and as figures with a floor."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure with a promise.

    promise: the value that an idle machine must reach. floor: the value below which a run fails. disturbed: too much
    other work on the machine to judge the figure. exact: the figure is the same on any machine under any load.
    """

    name: str
    value: float
    promise: float
    floor: float
    better: Literal["more", "less"] = "more"
    disturbed: bool = False
    exact: bool = False

    @property
    def kept(self) -> bool:
        """Whether the promise is kept."""
        return self._reaches(self.promise)

    @property
    def above_floor(self) -> bool:
        """Whether the floor is reached."""
        return self._reaches(self.floor)

    @property
    def rank(self) -> int:
        """Rank among the verdicts, from good to bad; void ranks before the failures, because it proves nothing."""
        if self.disturbed:
            return 1
        return 0 if self.kept else 2 if self.above_floor else 3

    @property
    def verdict(self) -> str:
        """The verdict in a word or two."""
        return ("kept", "void", "not kept", "**floor broken**")[self.rank]

    def _reaches(self, mark: float) -> bool:
        return self.value >= mark if self.better == "more" else self.value <= mark


@dataclass(slots=True, kw_only=True)
class Section:
    """One table with its explanation, and the promised figures in it.

    void: the machine was too busy to measure it. failed: the measurement failed for another reason.
    """

    title: str
    about: str
    head: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    void: bool = False
    failed: bool = False

    @property
    def voids(self) -> int:
        """Number of results that cannot be judged."""
        return self.void + sum(figure.disturbed for figure in self.figures)

    def markdown(self) -> str:
        """Return the section as Markdown."""
        parts = [f"## {self.title}", "", self.about, ""]
        if self.rows:
            parts += table(self.head, self.rows)
            parts.append("")
        parts += [f"- {remark}" for remark in dict.fromkeys(self.remarks)]
        if self.remarks:
            parts.append("")
        return "\n".join(parts)


_ABOUT = (
    "The floor is what a run fails for; the promise is for a machine with nothing else to do. Void: most runs of it "
    "were disturbed by other work on the machine, however often they were repeated, so it is not judged."
)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [
        f"| {' | '.join(head)} |",
        f"|{'---|' * len(head)}",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def promises(figures: Iterable[Figure]) -> str:
    """Return a section with all promised figures, failures first."""
    ordered = sorted(figures, key=lambda figure: -figure.rank)
    rows = [
        (figure.name, f"{figure.value:.4g}", f"{figure.promise:.4g}", f"{figure.floor:.4g}", figure.verdict)
        for figure in ordered
    ]
    verdicts = Counter(figure.verdict for figure in ordered)
    counts = ", ".join(f"{number} {verdict}" for verdict, number in verdicts.items())
    return "\n".join(
        [
            "## Promises",
            "",
            f"{_ABOUT} Here: {counts}.",
            "",
            *table(("figure", "measured", "promise", "floor", ""), rows),
            "",
        ]
    )
