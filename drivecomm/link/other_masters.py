"""Other masters on a line: the evidence of them, their requests, and whether the line counts as shared.

Evidence is a whole, sound telegram of one of the line's protocols that no request of ours explains: a request that was
not sent from here, or a reply that none of our requests can have caused. Single bytes of noise, damage, our own echo,
and late or repeated replies are not evidence, nor are telegrams so short that noise could look like one.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, Noise

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    from drivecomm.link.peer import DriveRecord, Peer
    from drivecomm.protocol import Codec, Direction, Message

EVIDENCE = 2
"""Number of foreign telegrams that make a line a shared one: a request of another master and its reply."""
SHARED_S = 60.0
"""Time in seconds within which these telegrams must come.

After the last of them the line still counts as shared for the same time.
"""
CAREFUL_S = 2.0
"""Time in seconds after the opening of a network port in which the link listens for second replies.

It does so for every reply that names nothing of its request, as on a shared line.
"""
SHORTEST_EVIDENCE = 6
"""Minimum length in bytes; shorter telegrams, such as an acknowledgement of two characters, may be noise."""
STRAGGLING_S = 5.0
"""Time in seconds after `late_s` in which a late reply is still recognised as one."""

SHARED = (
    "another master is on this line, or a gateway that passes every reply on to all of its clients: readings whose "
    "replies do not identify their request are uncertain; end the other master, or give each a line of its own"
)
MAY_BE_ANOTHERS = "another master is on this line, and this may be a reply to it"
_MOST_LOOKED_AT = 1024
_MOST_TONGUES = 16


class OpenRequest(NamedTuple):
    """A request, ours or another master's, whose reply may still come.

    until: end of the time in which the reply may come. instead: requests that may get the outstanding reply in place of
    this one: an earlier reply fitted several of them, and may have answered any.
    """

    data: bytes
    message: Message
    mismatch: Callable[[Message, Message], str]
    until: float
    instead: tuple[OpenRequest, ...] = ()

    def may_bring(self, reply: Message) -> bool:
        """Return whether a sound reply may be the outstanding one."""
        try:
            fits = not self.mismatch(self.message, reply)
        except TelegramError:
            # A reply decoded as a request can have fields that no request has.
            fits = False
        return fits or any(each.may_bring(reply) for each in self.instead)

    def with_alternative(self, other: OpenRequest) -> OpenRequest:
        """Return this request, with another one that may get the outstanding reply in its place."""
        known = {self.data, *(each.data for each in self.instead)}
        more = tuple(each._replace(instead=()) for each in (other, *other.instead) if each.data not in known)
        return self._replace(instead=self.instead + more, until=max(self.until, other.until))


class OtherMasters:
    """Knowledge about other masters on one line.

    records: records of the drives of this line, by name. on_shared: called with the reason each time the line begins
    to count as shared.
    """

    def __init__(self, records: dict[str, DriveRecord], on_shared: Callable[[str], None] | None) -> None:
        self.careful_until = float("-inf")
        self._on_shared = on_shared
        self._records = records
        self._tongues: dict[Any, _SpokenProtocol] = {}
        self._asked: list[OpenRequest] = []
        self._heard_at: deque[float] = deque(maxlen=EVIDENCE)
        self._shared_until = float("-inf")
        self._drives: dict[str, float] = {}
        self.passed_by = b""
        """Bytes that answered no request and are not examined yet."""

    def may_be_shared(self, now: float) -> None:
        """Listen for second replies for a while.

        A gateway may pass on replies to other masters, whose requests are not heard here.
        """
        self.careful_until = max(self.careful_until, now + CAREFUL_S)

    def speaks(self, peer: Peer) -> None:
        """Record a protocol that is spoken on this line."""
        key = peer.protocol, getattr(peer.codec, "alike", id(peer.codec))
        if len(self._tongues) < _MOST_TONGUES:
            self._tongues.setdefault(key, _SpokenProtocol(peer.protocol, peer.codec, peer.mismatch))

    def shared(self, now: float) -> bool:
        """Return whether the line counts as shared with another master."""
        return now < self._shared_until

    def heard_lately(self, now: float) -> bool:
        """Return whether a foreign telegram, even a single one, was heard within the last minute."""
        return bool(self._heard_at) and now - self._heard_at[-1] < SHARED_S

    def uses_drive(self, drive: str, now: float) -> bool:
        """Return whether another master uses this drive, too.

        That is assumed if the line is shared and a foreign telegram of the drive was heard within the last minute.
        """
        return self.shared(now) and now - self._drives.get(drive, float("-inf")) < SHARED_S

    def may_have_requested(self, data: bytes, reply: Message, now: float) -> bool:
        """Return whether a reply may belong to a request of another master that differs from `data`."""
        if self._asked:
            self._asked = [each for each in self._asked if each.until > now]
        return any(each.data != data and each.may_bring(reply) for each in self._asked)

    def may_be_answered_by(self, reply: Message) -> bool:
        """Return whether a reply may belong to another master's request; that request is then no longer open."""
        for number, question in enumerate(self._asked):
            if question.may_bring(reply):
                del self._asked[number]
                return True
        return False

    def pass_by(self, data: bytes) -> None:
        """Store bytes that answered no request until `judge` examines them."""
        self.passed_by = (self.passed_by + data)[-_MOST_LOOKED_AT:]

    def judge(self, peer: Peer, ours: Iterable[bytes], now: float) -> None:
        """Examine the stored bytes for foreign telegrams.

        ours: telegrams that were just sent from here, whose echo the bytes may be.
        """
        if not self.passed_by:
            return
        data, self.passed_by = self.passed_by, b""
        if len(data) < SHORTEST_EVIDENCE:
            return
        sent = {*ours, *(record.last[0] for record in self._records.copy().values())}
        for readings in _telegrams(data, self._tongues.values()):
            if not any(self._is_explained(each, sent) for each in readings):
                self._foreign(readings, peer, now)

    def _is_explained(self, reading: _Reading, sent: set[bytes]) -> bool:
        """Return whether our own traffic explains a telegram: as an echo, a late reply, or a copy of the last reply."""
        records = self._records.copy().values()
        if reading.direction == "request":
            return reading.data in sent or any(each.data == reading.data for one in records for each in one.owed)
        return any(one.has_come(reading.message) or one.is_copy(reading.data) for one in records)

    def _foreign(self, readings: list[_Reading], peer: Peer, now: float) -> None:
        timing = peer.facts.timing
        replies = [each.message for each in readings if each.direction == "reply"]
        for reply in replies:
            self.may_be_answered_by(reply)
        for each in readings:
            # A telegram that can be read as either is usually a reply, of another protocol or of the same one.
            if not replies:
                until = now + timing.reply_timeout_s + peer.gap_s
                self._asked.append(OpenRequest(each.data, each.message, each.mismatch, until))
            # The address in a reply shows which drive the other master uses.
            self._drives[f"{each.protocol}:{getattr(each.message, 'address', '')}"] = now
        was_shared = self.shared(now)
        self._heard_at.append(now)
        self.careful_until = max(self.careful_until, now + SHARED_S)
        if len(self._heard_at) == EVIDENCE and now - self._heard_at[0] < SHARED_S:
            self._shared_until = now + SHARED_S
            if self._on_shared is not None and not was_shared:
                self._on_shared(SHARED)


class _SpokenProtocol(NamedTuple):
    """A protocol that is spoken on a line."""

    protocol: str
    codec: Codec
    mismatch: Callable[[Message, Message], str]


class _Reading(NamedTuple):
    """Bytes decoded as a telegram of one protocol and direction."""

    data: bytes
    direction: Direction
    message: Message
    mismatch: Callable[[Message, Message], str]
    protocol: str


def _telegrams(data: bytes, tongues: Iterable[_SpokenProtocol]) -> Iterator[list[_Reading]]:
    """Yield the sound telegrams in the data, in order, each with all its possible readings."""
    found: dict[tuple[int, int], list[_Reading]] = {}
    for tongue in tongues:
        directions: tuple[Direction, ...] = ("request", "reply")
        for direction in directions:
            framer, place = Framer(tongue.codec, direction), 0
            for find in (*framer.feed(data), *framer.flush()):
                if isinstance(find, Framed):
                    end = place + len(find.data)
                    if len(find.data) >= SHORTEST_EVIDENCE:
                        # The negative end sorts the longest telegram first if several begin at the same byte.
                        found.setdefault((place, -end), []).append(
                            _Reading(find.data, direction, find.message, tongue.mismatch, tongue.protocol)
                        )
                    place = end
                elif isinstance(find, Noise):
                    place += len(find.data)
    over = 0
    for (begin, end), readings in sorted(found.items(), key=lambda each: each[0]):
        if begin >= over:
            over = -end
            yield readings
