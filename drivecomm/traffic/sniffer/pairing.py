"""Requests and what became of them: answered, and how quickly; repeated; answered late, or never."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.traffic.sniffer.heard import HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Protocol
    from drivecomm.traffic.sniffer.heard import Finding

Outcome: TypeAlias = Literal["answered", "late", "unanswered", "stray"]

_KEPT_UNANSWERED = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A request and its reply.

    outcome: answered; late: the master had gone on already; unanswered: it went on, and no reply came; stray: a reply
    to nothing that was asked. reply_time_s: from the request's last character to the reply's last one. retries: how
    often the master had asked the same before.
    """

    outcome: Outcome
    request: HeardTelegram | None
    reply: HeardTelegram | None
    reply_time_s: float | None = None
    retries: int = 0

    @property
    def drive(self) -> str:
        """Who was asked or answered."""
        telegram = self.request or self.reply
        return telegram.drive if telegram else ""


@dataclass(slots=True)
class Pairing:
    """Pairs the telegrams of one line; one master asks one thing at a time. protocols: those that may be spoken."""

    protocols: Iterable[Protocol]
    _by_name: dict[str, Protocol] = field(init=False)
    _open: HeardTelegram | None = None
    _retries: int = 0
    _unanswered: deque[HeardTelegram] = field(default_factory=lambda: deque(maxlen=_KEPT_UNANSWERED))

    def __post_init__(self) -> None:
        self._by_name = {protocol.name: protocol for protocol in self.protocols}

    @property
    def retries(self) -> int:
        """How often the open request had been asked before in a row."""
        return self._retries

    def feed(self, finding: Finding) -> list[Pair]:
        """Take what was heard next; return what is now known to be over."""
        if not isinstance(finding, HeardTelegram):
            return []
        return self._request(finding) if finding.direction == "request" else [self._reply(finding)]

    def finish(self) -> list[Pair]:
        """Return what is open when nothing follows."""
        return self._leave()

    def _request(self, request: HeardTelegram) -> list[Pair]:
        if not request.expects_reply:
            return self._leave()
        before = self._open
        over = self._leave()
        again = before is not None and (before.protocol, before.data) == (request.protocol, request.data)
        self._retries = self._retries + 1 if again else 0
        self._open = request
        return over

    def _leave(self) -> list[Pair]:
        if self._open is None:
            return []
        over = Pair(outcome="unanswered", request=self._open, reply=None, retries=self._retries)
        self._unanswered.append(self._open)
        self._open = None
        return [over]

    def _reply(self, reply: HeardTelegram) -> Pair:
        if self._open is not None and self._belongs(self._open, reply):
            request, self._open = self._open, None
            took_s = reply.time_s - request.time_s
            return Pair(outcome="answered", request=request, reply=reply, reply_time_s=took_s, retries=self._retries)
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
