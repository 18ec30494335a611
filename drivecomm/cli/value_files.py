"""Additional output files of commands: --log for values, --record for the bytes of a line."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.output import complain
from drivecomm.cli.values import FILE
from drivecomm.errors import DriveCommError
from drivecomm.plant.value_log import open_log

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from drivecomm.line import PollResult

log_option = click.option("--log", type=FILE, help="Log every value to a file: .csv or .parquet.")


@contextmanager
def opened_log(path: Path | None, *, as_json: bool) -> Iterator[Callable[[PollResult], Any]]:
    """Open the log, if one is requested, for the time of the block; yield a callback for every result.

    Raises DriveCommError at the end if rows are missing for lack of disk space.
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
        # Polling usually ends by Ctrl-C; missing rows matter more than the interrupt.
        if not log.missing:
            raise
    if log.missing:
        raise DriveCommError(log.summary)


_LOGGER = logging.getLogger("drivecomm.capture")


class _Said(logging.Handler):
    """Log handler that prints the warnings of a recording."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__(logging.WARNING)
        self.said = False
        self._as_json = as_json

    def emit(self, record: logging.LogRecord) -> None:
        self.said = True
        complain(record.getMessage(), as_json=self._as_json)


@contextmanager
def recorded(path: Path, *, as_json: bool) -> Iterator[None]:
    """Print problems of a recording during the block; raise DriveCommError at the end if there were any."""
    handler = _Said(as_json=as_json)
    propagates, _LOGGER.propagate = _LOGGER.propagate, False
    _LOGGER.addHandler(handler)
    try:
        yield
    finally:
        _LOGGER.removeHandler(handler)
        _LOGGER.propagate = propagates
    if handler.said:
        raise DriveCommError(f"{path}: the recording is incomplete")
