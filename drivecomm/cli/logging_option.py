"""The option --log of commands that read values again and again."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from drivecomm.polling import PollResult

Log = Annotated[
    Path | None, typer.Option("--log", metavar="FILE", help="Keep every value in a file: .csv or .parquet.")
]


def opened_log(stack: ExitStack, path: Path | None) -> Callable[[PollResult], Any]:
    """Open the log, if one is wanted, until the stack ends; return what is to be told every result."""
    if path is None:
        return lambda _: None
    # Files and their forms are for those who keep a log.
    from drivecomm.value_log import open_log  # noqa: PLC0415

    return stack.enter_context(open_log(path)).write
