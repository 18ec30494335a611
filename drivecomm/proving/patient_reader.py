"""Requests to one drive that distinguish a missing reply to one request from a drive that is away."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import (
    DriveCommError,
    DriveError,
    LinkError,
    NoReplyError,
    OvertakenError,
    ReplyError,
    UnexpectedReplyError,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import Drive

T = TypeVar("T")

PAUSES_S = (0.5, 1.0, 2.0, 5.0)
"""Pauses in seconds between attempts to reach a silent drive."""

_ENOUGH = 2


class PatientReader:
    """Sender of requests to one drive that waits until an absent drive is back."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive

    def answer(self, ask: Callable[[], T]) -> T | DriveCommError:
        """Return the result of a request, or the error that concerns this request.

        If the drive still answers its probe, and the request gets no reply twice, the missing reply is returned as the
        error: some drives are silent where others refuse. Raises NoReplyError for a drive that answers nothing, and
        LinkError for a lost line.
        """
        silences = 0
        while True:
            told = self._once(ask)
            if not isinstance(told, ReplyError) or isinstance(told, UnexpectedReplyError):
                return told
            silences += not self._was_away(told)
            if silences == _ENOUGH:
                return told

    def _once(self, ask: Callable[[], T]) -> T | DriveCommError:
        while True:
            try:
                return ask()
            except LinkError:
                raise
            except OvertakenError:
                continue
            except DriveCommError as error:
                return error

    def _was_away(self, silence: ReplyError) -> bool:
        """Wait until the drive answers its probe; return whether it had to be waited for. Raises NoReplyError."""
        for pause_s in (0.0, *PAUSES_S):
            if pause_s:
                self._drive.bus.sleep_until(self._drive.bus.now() + pause_s)
            if self._is_there():
                return pause_s > 0
        raise NoReplyError(f"{self._drive.name} fell silent, and stayed so for {sum(PAUSES_S):g} s") from silence

    def _is_there(self) -> bool:
        try:
            self._drive.probe()
        except DriveError:
            return True
        except ReplyError:
            return False
        return True
