"""The option --log of commands that read values again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.cli.output import complain
from drivecomm.errors import DriveCommError
from drivecomm.plant.value_log import open_log

if TYPE_CHECKING:
    from drivecomm.polling import PollResult

Log = Annotated[Path | None, typer.Option("--log", metavar="FILE", help="Log every value to a file: .csv or .parquet.")]


@contextmanager
def opened_log(path: Path | None, *, as_json: bool) -> Iterator[Callable[[PollResult], Any]]:
    """Open the log, if one is wanted, for the time of the block; yield what is to be told every result.

    Raises DriveCommError at the end when rows are missing because there was no room for them.
    """
    if path is None:
        yield lambda _: None
        return
    tell = partial(complain, as_json=as_json)
    log = open_log(path, tell=tell)
    try:
        with log:
            yield log.write
    except DriveCommError:
        if log.missing:
            tell(log.summary)
        raise
    except KeyboardInterrupt:
        # The usual end of polling; that something is missing is more than that.
        if not log.missing:
            raise
    if log.missing:
        raise DriveCommError(log.summary)
