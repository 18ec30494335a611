"""The steps of the tour: each is shown, and counted as done or failed."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rich.markup import escape

from drivecomm.cli.output import sentence
from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console


@dataclass(slots=True)
class Tour:
    """A console to print on, and what has been done so far: title, whether it worked, what was seen."""

    console: Console
    steps: list[tuple[str, bool, str]] = field(default_factory=list)

    @contextmanager
    def step(self, title: str) -> Iterator[Callable[[str], None]]:
        """Carry out a step; the block tells what it saw. Errors of the tree and failed checks fail the step."""
        seen: list[str] = []
        try:
            yield seen.append
        except (DriveCommError, AssertionError) as error:
            self.steps.append((title, False, sentence(error)))
            self.console.print(f"  [red]failed:[/red] {title}: {escape(sentence(error))}")
        else:
            self.steps.append((title, True, "; ".join(seen)))

    def heading(self, text: str) -> None:
        """Print the heading of a stop."""
        self.console.print(f"\n[bold cyan]{escape(text)}[/bold cyan]")

    @property
    def failed(self) -> int:
        """How many steps failed."""
        return sum(not worked for _, worked, _ in self.steps)
