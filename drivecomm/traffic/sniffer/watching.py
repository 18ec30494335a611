"""Everything about one line at once: telegrams, what answers what, and the count of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.traffic.sniffer.heard import HeardTelegram
from drivecomm.traffic.sniffer.pairing import Pair, Pairing
from drivecomm.traffic.sniffer.sniffer import Sniffer
from drivecomm.traffic.sniffer.tally import Tally

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.capture import Piece
    from drivecomm.link import Statistics
    from drivecomm.protocol import LineSettings, Protocol
    from drivecomm.traffic.sniffer.heard import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """What happened on a line.

    finding: what was heard; None when a request was given up without an answer. pair: for a reply, what it answers; for
    a request that was given up, that. retries: for a request, how often it had been asked before in a row.
    """

    line: str
    time_s: float
    finding: Finding | None
    pair: Pair | None = None
    retries: int = 0

    @property
    def drive(self) -> str:
        """Whom it concerns, as PROTOCOL:ADDRESS; empty where that is not known."""
        if self.finding is None:
            return self.pair.drive if self.pair else ""
        return getattr(self.finding, "drive", "") or getattr(self.finding, "protocol", "")

    @property
    def wrong(self) -> bool:
        """Whether it should not have happened: damage, a repetition, a reply that is missing, late or not asked for."""
        if not isinstance(self.finding, HeardTelegram):
            return True
        return self.retries > 0 or (self.pair is not None and self.pair.outcome != "answered")


class Watch:
    """Watches one line. name: the line's name in a capture; the rest as for `Sniffer`."""

    def __init__(
        self,
        protocols: Iterable[Protocol],
        *,
        name: str = "",
        settings: LineSettings | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        known = list(protocols)
        self._name = name
        self._sniffer = Sniffer(known, settings=settings, options=options)
        self._pairing = Pairing(known)
        self._tally = Tally()

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """What was counted, see `Tally.drives`."""
        return self._tally.drives

    def feed(self, piece: Piece) -> list[Event]:
        """Take bytes from the line; return what is now certain."""
        return self._events(self._sniffer.feed(piece))

    def flush(self, now: float) -> list[Event]:
        """Return what is certain now that nothing has come up to this time."""
        return self._events(self._sniffer.flush(now))

    def finish(self) -> list[Event]:
        """Return the rest, now that nothing follows."""
        events = self._events(self._sniffer.finish())
        return events + [self._given_up(pair, pair.request.time_s if pair.request else 0.0) for pair in self._left()]

    def _left(self) -> list[Pair]:
        pairs = self._pairing.finish()
        for pair in pairs:
            self._tally.pair(pair)
        return pairs

    def _events(self, findings: Iterable[Finding]) -> list[Event]:
        return [event for finding in findings for event in self._explained(finding)]

    def _explained(self, finding: Finding) -> list[Event]:
        events, mine, retries = [], None, 0
        for pair in self._pairing.feed(finding):
            self._tally.pair(pair)
            if pair.reply is finding:
                mine = pair
            else:
                events.append(self._given_up(pair, finding.time_s))
        if isinstance(finding, HeardTelegram) and finding.expects_reply:
            retries = self._pairing.retries
        self._tally.feed(finding)
        events.append(Event(line=self._name, time_s=finding.time_s, finding=finding, pair=mine, retries=retries))
        return events

    def _given_up(self, pair: Pair, time_s: float) -> Event:
        return Event(line=self._name, time_s=time_s, finding=None, pair=pair)
