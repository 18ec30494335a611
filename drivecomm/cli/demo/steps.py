"""Steps of the tour: each is shown, and counted as done or failed."""

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
    """Tour of the demo: its console, and the steps so far with title, success and observations."""

    console: Console
    steps: list[tuple[str, bool, str]] = field(default_factory=list)

    @contextmanager
    def step(self, title: str) -> Iterator[Callable[[str], None]]:
        """Run a step; the block reports its observations. DriveCommError and AssertionError fail the step."""
        seen: list[str] = []
        try:
            yield seen.append
        except (DriveCommError, AssertionError) as error:
            self.steps.append((title, False, sentence(error)))
            self.console.print(f"  [red]failed:[/red] {title}: {escape(sentence(error))}")
        else:
            self.steps.append((title, True, "; ".join(seen)))

    def heading(self, text: str) -> None:
        """Print the heading of a part of the tour."""
        self.console.print(f"\n[bold cyan]{escape(text)}[/bold cyan]")

    @property
    def failed(self) -> int:
        """Number of failed steps."""
        return sum(not worked for _, worked, _ in self.steps)
