"""What was measured, as tables for people and as figures with a floor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure that is promised.

    promise: what an idle machine must reach; floor: what a noisy one must. disturbed: the instrument was not good
    enough in this run to judge it.
    """

    name: str
    value: float
    promise: float
    floor: float
    better: Literal["more", "less"] = "more"
    disturbed: bool = False

    @property
    def kept(self) -> bool:
        """Whether the promise is kept."""
        return self._reaches(self.promise)

    @property
    def above_floor(self) -> bool:
        """Whether at least the floor is reached."""
        return self._reaches(self.floor)

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.disturbed:
            return "not judged"
        if self.kept:
            return "kept"
        return "not kept" if self.above_floor else "**floor broken**"

    def _reaches(self, mark: float) -> bool:
        return self.value >= mark if self.better == "more" else self.value <= mark


@dataclass(slots=True, kw_only=True)
class Section:
    """One table, with what one must know to read it, and the figures in it that are promised."""

    title: str
    about: str
    head: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    failed: bool = False

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
    "The floor is what a run fails for; the promise is for a machine with nothing else to do. Not judged: most runs of "
    "it were disturbed by other work on the machine, as the emulator says of itself."
)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [
        f"| {' | '.join(head)} |",
        f"|{'---|' * len(head)}",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def promises(sections: Iterable[Section]) -> str:
    """Return a section with all promised figures."""
    rows = [
        (figure.name, f"{figure.value:.4g}", f"{figure.promise:g}", f"{figure.floor:g}", figure.verdict)
        for section in sections
        for figure in section.figures
    ]
    parts = [
        "## Promises",
        "",
        _ABOUT,
    ]
    return "\n".join([*parts, "", *table(("figure", "measured", "promise", "floor", ""), rows), ""])
