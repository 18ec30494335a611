"""Bytes outside of sound telegrams: damaged telegrams of a protocol spoken on the line, or unknown bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.traffic.sniffer.readings import BrokenTelegram
from drivecomm.traffic.sniffer.traffic_items import DamagedTelegram, UnknownBytes, drive_named_in

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.traffic.sniffer.directions import DirectionEstimator
    from drivecomm.traffic.sniffer.readings import TelegramReader
    from drivecomm.traffic.sniffer.traffic_items import TrafficItem
    from drivecomm.traffic.sniffer.undecided_bytes import UndecidedBytes


class DamageReport:
    """Explanation of the first undecided bytes of a line.

    readers_for: returns the readers for which a telegram can begin with a byte.
    """

    def __init__(
        self,
        stretch: UndecidedBytes,
        estimators: Mapping[str, DirectionEstimator],
        readers_for: Callable[[int], list[TelegramReader]],
    ) -> None:
        self._stretch = stretch
        self._estimators = estimators
        self._readers_for = readers_for

    def items(self, end: int) -> Iterator[TrafficItem]:
        """Yield the bytes before this position as damaged telegrams and unknown bytes."""
        start = unknown_from = 0
        while start < end:
            broken = self._broken_at(start, end) if self._may_begin(start, unknown_from) else None
            if broken is None:
                start += 1
                continue
            yield from self._unknown(unknown_from, start)
            yield self._damaged(broken)
            start = unknown_from = broken.end
        yield from self._unknown(unknown_from, end)

    def _may_begin(self, place: int, unknown_from: int) -> bool:
        return place == unknown_from or self._stretch.silence_before(place) > self._stretch.quiet_s(place)

    def _broken_at(self, start: int, end: int) -> BrokenTelegram | None:
        """Return the most likely damaged telegram at this position, in a protocol spoken here; None if none fits."""
        found = []
        for reader in self._readers_for(self._stretch.data[start]):
            if self._estimators[reader.protocol.name].spoken:
                limit = min(end, self._stretch.unbroken_until(start, reader.gap_s))
                look = reader.look_at_rest(self._stretch.data, start, limit)
                if isinstance(look, BrokenTelegram):
                    found.append(look)
        return max(found, key=self._likelihood, default=None)

    def _likelihood(self, broken: BrokenTelegram) -> tuple[bool, bool]:
        """Return a sort key for the likelihood of a damaged telegram.

        A telegram with a wrong check was probably whole. A request is likely while no reply is due, a reply while one
        is.
        """
        due = self._estimators[broken.protocol.name].awaited(self._stretch.began_s(broken.start)) is not None
        return broken.error.category in ("checksum", "field"), due == (broken.direction == "reply")

    def _damaged(self, broken: BrokenTelegram) -> DamagedTelegram:
        estimator = self._estimators[broken.protocol.name]
        asked = estimator.awaited(self._stretch.began_s(broken.start)) if broken.direction == "reply" else None
        ended_s = self._stretch.ended_s(broken.end - 1)
        if broken.direction == "request":
            estimator.mishear(ended_s)
        return DamagedTelegram(
            time_s=ended_s,
            protocol=broken.protocol.name,
            direction=broken.direction,
            drive="" if asked is None else drive_named_in(broken.protocol, asked),
            data=self._stretch.data[broken.start : broken.end],
            error=broken.error,
        )

    def _unknown(self, start: int, end: int) -> Iterator[UnknownBytes]:
        if start < end:
            yield UnknownBytes(time_s=self._stretch.ended_s(end - 1), data=self._stretch.data[start:end])
