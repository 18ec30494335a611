"""The files that commands fill besides what they print: --log for values, --record for the bytes of a line."""

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


_LOGGER = logging.getLogger("drivecomm.capture")


class _Said(logging.Handler):
    """Says on the command line what the recording of the block says."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__(logging.WARNING)
        self.said = False
        self._as_json = as_json

    def emit(self, record: logging.LogRecord) -> None:
        self.said = True
        complain(record.getMessage(), as_json=self._as_json)


@contextmanager
def recorded(path: Path, *, as_json: bool) -> Iterator[None]:
    """Say what goes wrong with a recording meanwhile; raise DriveCommError at the end if anything did."""
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
