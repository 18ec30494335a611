"""A fault of a plant's script that happens to telegrams: which ones, and how often."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from drivecomm.plant import disturbed
from drivecomm.protocol import fields_of
from drivecomm.virtual.planted_drive import PlantedDrive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.plant import TelegramFault
    from drivecomm.protocol import VirtualDrive


class TelegramDisturbance:
    """Disturbs the telegrams that a fault names. met: how many of them there were; happened: how many it disturbed.

    speed: seconds of the process for each second of the line.
    """

    def __init__(self, fault: TelegramFault, speed: float) -> None:
        self.fault = fault
        self.met = 0
        self.happened = 0
        self._speed = speed
        self._random = Random(fault.seed)  # noqa: S311 - repeatable on purpose

    def request(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """Return what arrives of a request."""
        if self.fault.drive or self.fault.of not in (None, "request"):
            return [(0.0, data)]
        return self._disturbed(data, now)

    def reply(self, data: bytes, drive: VirtualDrive, now: float) -> Sequence[tuple[float, bytes]]:
        """Return what arrives of a reply."""
        if not isinstance(drive, PlantedDrive) or not self._means(drive):
            return [(0.0, data)]
        return self._disturbed(data, now)

    def _means(self, drive: PlantedDrive) -> bool:
        fault = self.fault
        if fault.of == "request" or (fault.drive and fault.drive != drive.name):
            return False
        if fault.of not in (None, "reply", f"reply to a {drive.purpose}"):
            return False
        if not fault.to:
            return True
        asked = fields_of(drive.asked) if drive.asked is not None else {}
        return all(asked.get(name) == wanted for name, wanted in fault.to.items())

    def _disturbed(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        fault = self.fault
        if not data or not fault.window.holds(now * self._speed):
            return [(0.0, data)]
        self.met += 1
        if fault.every is not None and self.met % fault.every:
            return [(0.0, data)]
        if fault.rate is not None and self._random.random() >= fault.rate:
            return [(0.0, data)]
        self.happened += 1
        return disturbed(fault.kind, data, self._random, delay_s=fault.delay_s)
