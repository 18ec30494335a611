"""Recurring trouble, reported once when it begins and once when it has ended. No I/O, no clock."""

from __future__ import annotations


class Spell:
    """A spell of incidents that belong together.

    begins_after_s: seconds for which incidents must recur before the spell begins; 0 for the first incident. quiet_s:
    seconds without an incident after which the spell ends. Times are seconds of a monotonic clock.
    """

    def __init__(self, *, begins_after_s: float, quiet_s: float) -> None:
        self._begins_after_s, self._quiet_s = begins_after_s, quiet_s
        self._first_s = self._last_s = 0.0
        self.incidents = 0
        """Number of incidents of this spell."""
        self.is_on = False

    @property
    def lasted_s(self) -> float:
        """Seconds from the first incident of this spell to the last."""
        return self._last_s - self._first_s

    def seen(self, now_s: float, incidents: int = 1) -> bool:
        """Count incidents; return whether the spell begins with them."""
        if not self.is_on and (not self.incidents or now_s - self._last_s > self._quiet_s):
            self.incidents, self._first_s = 0, now_s
        self.incidents += incidents
        self._last_s = now_s
        begins = not self.is_on and self.lasted_s >= self._begins_after_s
        self.is_on = self.is_on or begins
        return begins

    def ends(self, now_s: float) -> bool:
        """Return whether the spell ends now, after `quiet_s` seconds without an incident; True once for each spell."""
        over = self.is_on and now_s - self._last_s > self._quiet_s
        if over:
            self.is_on = False
        return over

    def forget(self) -> None:
        """End the spell without a report, because something graver has happened."""
        self.incidents, self.is_on = 0, False
