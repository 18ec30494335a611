"""Audit of requests that a door refuses itself: the first of a kind immediately, then at most one a second."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.server import Caller, CommandRequest, ServedPlant

EVERY_S = 1.0
_MOST_KINDS = 1000


class Refusals:
    """Audit of refusals; used only within a door's event loop."""

    def __init__(self, plant: ServedPlant) -> None:
        self._plant = plant
        self._noted: OrderedDict[tuple[str, str, str], tuple[float, int]] = OrderedDict()

    def note(self, caller: Caller, command: CommandRequest, why: str) -> None:
        """Record a refusal in the audit. Repetitions of the same kind within a second are only counted."""
        kind, now = (caller.name, command.drive, why), time.monotonic()
        last_s, left_out = self._noted.pop(kind, (now - EVERY_S, 0))
        if now - last_s < EVERY_S:
            self._noted[kind] = last_s, left_out + 1
            return
        self._noted[kind] = now, 0
        while len(self._noted) > _MOST_KINDS:
            self._noted.popitem(last=False)
        text = f"{why}; {left_out} more since the last such record" if left_out else why
        self._plant.refuse(caller, command, text)
