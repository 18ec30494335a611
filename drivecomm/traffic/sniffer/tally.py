"""What a listener counts for each drive."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.link import Statistics
from drivecomm.traffic.sniffer.heard import AmbiguousTelegram, DamagedTelegram, UnknownBytes

if TYPE_CHECKING:
    from drivecomm.traffic.sniffer.heard import Finding
    from drivecomm.traffic.sniffer.pairing import Pair

LINE = "line"
"""Under this name stands what belongs to no drive."""


@dataclass(slots=True)
class Tally:
    """Statistics by drive, PROTOCOL:ADDRESS, in the words of `drivecomm.link.statistics.COUNTERS`.

    What belongs to a protocol but to no drive stands under the protocol's name, unknown bytes under `line`.
    """

    drives: dict[str, Statistics] = field(default_factory=lambda: defaultdict(Statistics))
    _damaged: set[str] = field(default_factory=set)

    def feed(self, finding: Finding) -> None:
        """Count what was heard."""
        if isinstance(finding, DamagedTelegram):
            self._count(finding.drive or finding.protocol, f"{finding.error.category} errors")
            if finding.drive:
                self._damaged.add(finding.drive)
        elif isinstance(finding, UnknownBytes | AmbiguousTelegram):
            self._count(LINE, "noise bytes", len(finding.data))
        elif finding.broadcast:
            self._count(finding.drive, "requests")

    def pair(self, pair: Pair) -> None:
        """Count what became of a request."""
        if pair.outcome in ("stray", "late"):
            # The request of a late reply has been counted as unanswered.
            self._count(pair.drive, "strays")
            return
        self._count(pair.drive, "retries" if pair.retries else "requests")
        if pair.outcome == "answered":
            self._count(pair.drive, "replies")
            if pair.reply_time_s is not None:
                self.drives[pair.drive].reply_times.add(pair.reply_time_s)
        else:
            self._count(pair.drive, "damaged" if pair.drive in self._damaged else "timeouts")
        self._damaged.discard(pair.drive)

    def _count(self, drive: str, name: str, number: int = 1) -> None:
        self.drives[drive].counters[name] += number
