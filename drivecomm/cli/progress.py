"""A progress bar on a terminal; what a script reads shows nothing of it."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Progress: TypeAlias = Callable[[str, int, int], None]


@contextmanager
def progress_bar(what: str, *, shown: bool) -> Iterator[Progress]:
    """Yield a function that is told what is done now, how much is done, and of how much; on standard error."""
    if not (shown and sys.stderr.isatty()):
        yield lambda *_: None
        return
    from rich.console import Console  # noqa: PLC0415 - rich is loaded only where something is drawn
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # What is printed to standard output meanwhile stands above the bar where both are one terminal.
    redirected = sys.stdout.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=redirected) as drawing:
        task = drawing.add_task(what, total=None)

        def show(detail: str, done: int, total: int) -> None:
            drawing.update(task, description=f"{what} {detail}".rstrip(), completed=done, total=total)

        yield show
