"""The alarms of a plant in a thread of their own, as a door is: what they deliver holds up nobody."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.server.alarms import Alarm, PlantAlarms
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import ServedPlant


class AlarmWatch:
    """Watches over the alarms of a plant, and tells doors of them."""

    name = "alarms"

    def __init__(self, alarms: PlantAlarms) -> None:
        self._alarms = alarms

    async def run(self, _plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Watch until cancelled."""
        opened()
        await self._alarms.run()

    def standing(self) -> Sequence[Alarm]:
        """Return the alarms that are on, or that nobody has acknowledged."""
        return self._alarms.standing()

    def acknowledge(self, caller: Caller, alarm: str) -> Alarm:
        """Acknowledge one, and return it. Raises UsageError and NotAllowedError."""
        found = next((each for each in self.standing() if each.id == alarm), None)
        if found is None:
            raise UsageError(f"there is no alarm {alarm!r} that stands")
        self._alarms.acknowledge(caller, alarm)
        # One that was over already stands no longer.
        return next((each for each in self.standing() if each.id == alarm), found)
