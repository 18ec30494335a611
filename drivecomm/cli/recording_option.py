"""The option --record: what goes wrong with a recording is said, and told by the exit code."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.cli.output import complain
from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

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
