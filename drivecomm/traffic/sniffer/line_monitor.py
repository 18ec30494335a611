"""One monitored line: its telegrams, its pairs of request and reply, and statistics for each drive."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from drivecomm.link import Statistics
from drivecomm.traffic.sniffer.sniffer import Sniffer
from drivecomm.traffic.sniffer.traffic_items import DamagedTelegram, HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.capture import Piece
    from drivecomm.protocol import LineSettings, Protocol
    from drivecomm.traffic.sniffer.traffic_items import TrafficItem


class LineEvent(NamedTuple):
    """An event on a line.

    item: the telegram or bytes heard; None if a request went unanswered. pair: the request and reply that end with this
    event, or the request that went unanswered. retries: number of times that a request was sent before in a row.
    """

    line: str
    time_s: float
    item: TrafficItem | None
    pair: Pair | None = None
    retries: int = 0

    @property
    def drive(self) -> str:
        """The drive concerned, as PROTOCOL:ADDRESS, or the protocol alone; empty if unknown."""
        item = self.item
        if isinstance(item, HeardTelegram):
            return item.drive
        if item is None:
            return self.pair.drive if self.pair else ""
        return getattr(item, "drive", "") or getattr(item, "protocol", "")

    @property
    def wrong(self) -> bool:
        """Whether the event is a fault: damage, a repetition, or a missing, late or stray reply."""
        if not isinstance(self.item, HeardTelegram):
            return True
        return self.retries > 0 or (self.pair is not None and self.pair.outcome != "answered")


class LineMonitor:
    """Monitor of one line. name: the line's name in a capture. The other arguments are those of `Sniffer`."""

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
        """The counters of each drive, see `Tally.drives`."""
        return self._tally.drives

    def feed(self, piece: Piece) -> list[LineEvent]:
        """Process bytes from the line; return the events that are now certain."""
        return self._events(self._sniffer.feed(piece))

    def flush(self, now: float) -> list[LineEvent]:
        """Return the events that are certain because the line has been silent up to this time."""
        return self._events(self._sniffer.flush(now))

    def finish(self) -> list[LineEvent]:
        """Return the remaining events at the end of the traffic."""
        events = self._events(self._sniffer.finish())
        return events + [self._given_up(pair, pair.request.time_s if pair.request else 0.0) for pair in self._left()]

    def _left(self) -> list[Pair]:
        pairs = self._pairing.finish()
        for pair in pairs:
            self._tally.pair(pair)
        return pairs

    def _events(self, items: Iterable[TrafficItem]) -> list[LineEvent]:
        return [event for item in items for event in self._explained(item)]

    def _explained(self, item: TrafficItem) -> list[LineEvent]:
        events, mine, retries = [], None, 0
        for pair in self._pairing.feed(item):
            self._tally.pair(pair)
            if pair.reply is item:
                mine = pair
            else:
                events.append(self._given_up(pair, item.time_s))
        if isinstance(item, HeardTelegram) and item.expects_reply:
            retries = self._pairing.retries
        self._tally.feed(item)
        events.append(LineEvent(self._name, item.time_s, item, mine, retries))
        return events

    def _given_up(self, pair: Pair, time_s: float) -> LineEvent:
        return LineEvent(line=self._name, time_s=time_s, item=None, pair=pair)


PairOutcome: TypeAlias = Literal["answered", "late", "unanswered", "stray"]

_KEPT_UNANSWERED = 8


class Pair(NamedTuple):
    """A request and its reply.

    outcome: "answered"; "late": answered after the master had continued; "unanswered": the master continued and no
    reply came; "stray": a reply without a request. reply_time_s: from the request's last character to the reply's last
    one. retries: number of times that the master had sent the same request before.
    """

    outcome: PairOutcome
    request: HeardTelegram | None
    reply: HeardTelegram | None
    reply_time_s: float | None = None
    retries: int = 0

    @property
    def drive(self) -> str:
        """The drive to which the request or from which the reply was sent."""
        telegram = self.request or self.reply
        return telegram.drive if telegram else ""


@dataclass(slots=True)
class Pairing:
    """Pairing of the requests and replies of one line, whose master has one request open at a time.

    protocols: protocols that may be spoken.
    """

    protocols: Iterable[Protocol]
    _by_name: dict[str, Protocol] = field(init=False)
    _open: HeardTelegram | None = None
    retries: int = field(default=0, init=False)
    """Number of times that the open request was sent before in a row."""
    _unanswered: deque[HeardTelegram] = field(default_factory=lambda: deque(maxlen=_KEPT_UNANSWERED))

    def __post_init__(self) -> None:
        self._by_name = {protocol.name: protocol for protocol in self.protocols}

    def feed(self, item: TrafficItem) -> list[Pair]:
        """Process the next item; return the pairs that are now complete."""
        if not isinstance(item, HeardTelegram):
            return []
        return self._request(item) if item.direction == "request" else [self._reply(item)]

    def finish(self) -> list[Pair]:
        """Return the open pair at the end of the traffic."""
        return self._leave()

    def _request(self, request: HeardTelegram) -> list[Pair]:
        if not request.expects_reply:
            return self._leave()
        before = self._open
        over = self._leave()
        again = before is not None and (before.protocol, before.data) == (request.protocol, request.data)
        self.retries = self.retries + 1 if again else 0
        self._open = request
        return over

    def _leave(self) -> list[Pair]:
        if self._open is None:
            return []
        over = Pair(outcome="unanswered", request=self._open, reply=None, retries=self.retries)
        self._unanswered.append(self._open)
        self._open = None
        return [over]

    def _reply(self, reply: HeardTelegram) -> Pair:
        if self._open is not None and self._belongs(self._open, reply):
            request, self._open = self._open, None
            took_s = reply.time_s - request.time_s
            return Pair("answered", request, reply, took_s, self.retries)
        for request in reversed(self._unanswered):
            if self._belongs(request, reply) and self._in_time(request, reply):
                self._unanswered.remove(request)
                return Pair(outcome="late", request=request, reply=reply, reply_time_s=reply.time_s - request.time_s)
        return Pair(outcome="stray", request=None, reply=reply)

    def _belongs(self, request: HeardTelegram, reply: HeardTelegram) -> bool:
        protocol = self._by_name.get(request.protocol)
        same = protocol is not None and request.protocol == reply.protocol
        return same and protocol is not None and not protocol.mismatch(request.message, reply.message)

    def _in_time(self, request: HeardTelegram, reply: HeardTelegram) -> bool:
        timing = self._by_name[request.protocol].facts.timing
        return reply.time_s - request.time_s <= timing.reply_timeout_s + timing.late_s


LINE = "line"
"""Key of the counters that belong to no drive."""


@dataclass(slots=True)
class Tally:
    """Statistics by drive, as PROTOCOL:ADDRESS; the counters are those of `drivecomm.link.statistics.COUNTERS`.

    Counters of a protocol without a known drive are under the protocol's name, unknown bytes under `line`.
    """

    drives: dict[str, Statistics] = field(default_factory=lambda: defaultdict(Statistics))
    _damaged: set[str] = field(default_factory=set)

    def feed(self, item: TrafficItem) -> None:
        """Count an item."""
        if isinstance(item, HeardTelegram):
            if not item.expects_reply and item.broadcast:
                self._count(item.drive, "requests")
        elif isinstance(item, DamagedTelegram):
            self._count(item.drive or item.protocol, f"{item.error.category} errors")
            if item.drive:
                self._damaged.add(item.drive)
        else:
            self._count(LINE, "noise bytes", len(item.data))

    def pair(self, pair: Pair) -> None:
        """Count the outcome of a request."""
        if pair.outcome in ("stray", "late"):
            # The request of a late reply has already been counted as unanswered.
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
