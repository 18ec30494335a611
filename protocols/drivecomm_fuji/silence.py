"""What a virtual Fuji inverter does when its host falls silent.

FRENIC-VG option manual 5-11 (H32, H33, H38); FRENIC-MEGA manual 5-274 and FRENIC-Mini manual 9-121 (y02, y03, y08);
HVAC/AQUA RS-485 manual 4-17: on the newer series a good frame to any station counts. Section 10 of the specification.

What no page says is chosen. On FRENIC-VG only frames to its own station and to all count. The time begins with the
first frame heard, and silence matters only while the link has the run command or the frequency, as on G11S (its
technical information, 2-57). With action 1 the trip comes also when the host speaks again before the timer is over.
y03 counts in tenths of a second where the model gives it no format. FVR-E11S and G11S have no function for the time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm_fuji.store import Store

COMMUNICATION_ALARM = 38
"""Er8, RS-485 communication."""

_TRIP, _RUN_THEN_TRIP, _TRIP_IF_IT_LASTS = 0, 1, 2


class SilenceWatch:
    """The silence detection of one inverter, over time. functions: `Profile.silence`."""

    def __init__(self, store: Store, functions: Mapping[str, Any]) -> None:
        self._store = store
        self._functions = functions
        self._heard_at: float | None = None
        self._trip_at: float | None = None

    def heard(self, now: float) -> None:
        """Take note of a good frame to this inverter or to all; what was due before has been asked for before."""
        self._heard_at = now

    def overheard(self, now: float) -> None:
        """Take note of a good frame to another station."""
        if self._heard_at is not None and self._functions.get("any_station"):
            self._heard_at = now

    def is_over(self, now: float) -> bool:
        """Whether nobody has been heard for longer than the function says."""
        if not self._functions or self._heard_at is None:
            return False
        time_s = self._store.number(self._functions["time"])
        return bool(time_s) and now > self._heard_at + time_s

    def forget(self) -> None:
        """Begin as after mains is switched on."""
        self._heard_at = self._trip_at = None

    def trip_due(self, now: float) -> float | None:
        """Return when the inverter trips, if it does so by now; None otherwise. A trip is told once."""
        if self._trip_at is None:
            self._trip_at = self._begun(now)
        if self._trip_at is None or now <= self._trip_at:
            return None
        due, self._trip_at, self._heard_at = self._trip_at, None, None
        return due

    def _begun(self, now: float) -> float | None:
        """Return when a trip that the silence has decided comes, None where it has decided none yet."""
        if self._heard_at is None or not self.is_over(now):
            return None
        noticed_at = self._heard_at + self._store.number(self._functions["time"])
        action = self._store.word_of(self._functions["action"])
        if action == _TRIP:
            return noticed_at
        timer = self._functions["timer"]
        trip_at = noticed_at + self._store.number(timer, self._store.word_of(timer) / 10)
        if action == _RUN_THEN_TRIP or (action == _TRIP_IF_IT_LASTS and now > trip_at):
            return trip_at
        return None
