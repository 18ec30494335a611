"""Selection of the drives that must hear a transmission, because most telegrams are for one drive of many."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING

from drivecomm.virtual.station import IgnoresOthers, shared_settings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import LineSettings
    from drivecomm.virtual.medium import Transmission
    from drivecomm.virtual.station import Station

_MOST_KNOWN = 512
_LONGEST_KNOWN = 300

_ears = attrgetter("inner.settings", "inner.address")


class Audience:
    """The stations of a line, with a cache of the stations that each transmission concerns.

    A cached entry stays valid until a drive that ignores telegrams to others changes its settings or its address.
    has_half_heard: whether any station has received an incomplete telegram; then every transmission concerns all
    stations.
    """

    def __init__(self, stations: Sequence[Station]) -> None:
        self.has_half_heard = False
        self._stations = stations
        self._passers = [station.drive for station in stations if isinstance(station.drive, IgnoresOthers)]
        self._ears: list[tuple[LineSettings, int]] = []
        self._known: dict[tuple[bytes, LineSettings | None], Sequence[Station]] = {}

    def of(self, sound: bytes, sent: Transmission) -> Sequence[Station]:
        """Return at least those stations whose drives use the audible characters of a transmission."""
        if self.has_half_heard:
            return self._stations
        ears = list(map(_ears, self._passers))
        if ears != self._ears:
            self._ears = ears
            self._known.clear()
        key = sound, None if sent.agreed else sent.settings
        known = self._known.get(key)
        if known is None:
            known = [station for station in self._stations if not _is_passed_over(station, sound, sent)]
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            if len(sound) <= _LONGEST_KNOWN:
                self._known[key] = known
        return known


def _is_passed_over(station: Station, sound: bytes, sent: Transmission) -> bool:
    spoken = station.agreed if sent.agreed else shared_settings(sent.settings)
    return station.passes_over(station.received(sound, spoken))
