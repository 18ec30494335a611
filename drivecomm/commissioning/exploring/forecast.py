"""How long it takes to ask for everything, before it is begun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.bus import ask_status
from drivecomm.errors import DriveError

if TYPE_CHECKING:
    from drivecomm.bus import Procedure
    from drivecomm.commissioning.exploring.course import Course

_QUESTIONS = 3
"""Some, because the first one may wait for the line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """How many addresses are still to be asked for, and how long that takes at the pace of a few status requests."""

    addresses: int
    seconds: float


def forecasting(way: Course, *, remembered: int = 0) -> Procedure[Forecast]:
    """Ask the drive for its status a few times, and say how long the whole way takes.

    remembered: of how many addresses the answers are there already. Raises ReplyError for a drive that does not answer.
    """
    left = max(0, len(way) - remembered)
    begun: float = yield lambda drive: drive.bus.now()
    for _ in range(_QUESTIONS):
        try:
            yield ask_status()
        except DriveError:
            # A refusal takes as long as a status.
            continue
    ended: float = yield lambda drive: drive.bus.now()
    return Forecast(addresses=left, seconds=left * (ended - begun) / _QUESTIONS)
