"""Forecast of the duration of an exploration, before it begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.bus import ask_status
from drivecomm.errors import DriveError

if TYPE_CHECKING:
    from drivecomm.bus import Procedure
    from drivecomm.commissioning.exploring.exploration_plan import ExplorationPlan

_QUESTIONS = 3
"""Number of status requests for the forecast; several, because the first one may wait for the line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationForecast:
    """Number of addresses left to request, and the seconds that they take at the pace of a few status requests."""

    addresses: int
    seconds: float


def forecasting(way: ExplorationPlan, *, remembered: int = 0) -> Procedure[ExplorationForecast]:
    """Request the status of a drive a few times, and forecast the duration of the whole exploration.

    remembered: number of addresses that already have an answer. Raises ReplyError for a drive that does not answer.
    """
    left = max(0, len(way) - remembered)
    begun: float = yield lambda drive: drive.bus.now()
    for _ in range(_QUESTIONS):
        try:
            yield ask_status()
        except DriveError:
            # A refusal takes as long as a status reply.
            continue
    ended: float = yield lambda drive: drive.bus.now()
    return ExplorationForecast(addresses=left, seconds=left * (ended - begun) / _QUESTIONS)
