"""Other masters on a line: how they show, what they have asked, and whether the line counts as shared.

Evidence is a whole, sound telegram of one of the line's protocols that no drive of ours was asked for: a request that
did not go out from here, or a reply that no request of ours can have brought. Single bytes of noise, damage, our own
echo, late replies and repeated ones are no evidence, nor are telegrams so short that noise could be one.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, Noise

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    from drivecomm.link.peer import Peer, PeerState
    from drivecomm.protocol import Codec, Direction, Message

EVIDENCE = 2
"""How many foreign telegrams make a line a shared one: one question of another master and its answer."""
SHARED_S = 60.0
"""Within so many seconds they must come, and so long after the last one the line still counts as shared."""
CAREFUL_S = 2.0
"""So long after a network port was opened every reply that names nothing is listened out, as on a shared line."""
SHORTEST_EVIDENCE = 6
"""Shorter telegrams, such as the two characters of an acknowledgement, may be noise."""
STRAGGLING_S = 5.0
"""How long after `late_s` a reply that still comes is known for what it is."""

SHARED = (
    "another master is on this line, or a gateway that passes every reply on to all of its clients: readings whose "
    "replies do not name what was asked are uncertain; end the other master, or give each a line of its own"
)
MAY_BE_ANOTHERS = "another master is on this line, and this may be a reply to it"
_MOST_LOOKED_AT = 1024
_MOST_TONGUES = 16


class Question(NamedTuple):
    """A request whose reply may still come, ours or another master's.

    until: how long. instead: requests whose reply may be the one that is still to come, in place of this one's: a reply
    came that fitted several of them, and nothing tells which it answered.
    """

    data: bytes
    message: Message
    mismatch: Callable[[Message, Message], str]
    until: float
    instead: tuple[Question, ...] = ()

    def may_bring(self, reply: Message) -> bool:
        """Whether a sound reply may be the one that is still to come."""
        try:
            fits = not self.mismatch(self.message, reply)
        except TelegramError:
            # Bytes of a reply, read as a request, may name what no request can.
            fits = False
        return fits or any(each.may_bring(reply) for each in self.instead)

    def or_that_to(self, other: Question) -> Question:
        """Return this where the reply to another request may be the one that is still to come."""
        known = {self.data, *(each.data for each in self.instead)}
        more = tuple(each._replace(instead=()) for each in (other, *other.instead) if each.data not in known)
        return self._replace(instead=self.instead + more, until=max(self.until, other.until))


class OtherMasters:
    """What is known of other masters on one line.

    partners: the drives of this line, by name. on_shared: told once each time that the line begins to count as shared.
    """

    def __init__(self, partners: dict[str, PeerState], on_shared: Callable[[str], None] | None) -> None:
        self.careful_until = float("-inf")
        self._on_shared = on_shared
        self._partners = partners
        self._tongues: dict[Any, _Tongue] = {}
        self._asked: list[Question] = []
        self._heard_at: deque[float] = deque(maxlen=EVIDENCE)
        self._shared_until = float("-inf")
        self._drives: dict[str, float] = {}
        self.passed_by = b""
        """Bytes that answered nothing and are still to be judged."""

    def may_be_shared(self, now: float) -> None:
        """Listen replies out for a while: a gateway may hand replies to others on, and nobody hears their requests."""
        self.careful_until = max(self.careful_until, now + CAREFUL_S)

    def speaks(self, peer: Peer) -> None:
        """Take note of a protocol that is spoken on this line."""
        key = peer.protocol, getattr(peer.codec, "alike", id(peer.codec))
        if len(self._tongues) < _MOST_TONGUES:
            self._tongues.setdefault(key, _Tongue(peer.protocol, peer.codec, peer.mismatch))

    def shared(self, now: float) -> bool:
        """Whether the line counts as one that another master uses, too."""
        return now < self._shared_until

    def heard_lately(self, now: float) -> bool:
        """Whether anything foreign was heard within the last minute, be it one telegram only."""
        return bool(self._heard_at) and now - self._heard_at[-1] < SHARED_S

    def ask_too(self, drive: str, now: float) -> bool:
        """Whether another master asks this drive as well, as far as is known: the line is shared, and it was heard."""
        return self.shared(now) and now - self._drives.get(drive, float("-inf")) < SHARED_S

    def may_have_asked_for(self, data: bytes, reply: Message, now: float) -> bool:
        """Whether a reply may be the one to another master's request, other than these bytes."""
        if self._asked:
            self._asked = [each for each in self._asked if each.until > now]
        return any(each.data != data and each.may_bring(reply) for each in self._asked)

    def may_be_answered_by(self, reply: Message) -> bool:
        """Whether a reply may be the one to another master's request; that one is expected no longer."""
        for number, question in enumerate(self._asked):
            if question.may_bring(reply):
                del self._asked[number]
                return True
        return False

    def pass_by(self, data: bytes) -> None:
        """Keep bytes that answered nothing, to be judged as soon as they are whole."""
        self.passed_by = (self.passed_by + data)[-_MOST_LOOKED_AT:]

    def judge(self, peer: Peer, ours: Iterable[bytes], now: float) -> None:
        """See what has passed by. ours: telegrams that went out from here just now, whose echo this may be."""
        if not self.passed_by:
            return
        data, self.passed_by = self.passed_by, b""
        if len(data) < SHORTEST_EVIDENCE:
            return
        sent = {*ours, *(partner.last[0] for partner in self._partners.copy().values())}
        for readings in _telegrams(data, self._tongues.values()):
            if not any(self._is_explained(each, sent) for each in readings):
                self._foreign(readings, peer, now)

    def _is_explained(self, reading: _Reading, sent: set[bytes]) -> bool:
        """Whether something of ours brings this: our echo, a late reply, one more copy of the last one."""
        partners = self._partners.copy().values()
        if reading.direction == "request":
            return reading.data in sent or any(each.data == reading.data for one in partners for each in one.owed)
        return any(one.has_come(reading.message) or one.is_copy(reading.data) for one in partners)

    def _foreign(self, readings: list[_Reading], peer: Peer, now: float) -> None:
        timing = peer.facts.timing
        replies = [each.message for each in readings if each.direction == "reply"]
        for reply in replies:
            self.may_be_answered_by(reply)
        for each in readings:
            # What may be either is mostly a reply: one telegram of two protocols, or of one whose requests look alike.
            if not replies:
                until = now + timing.reply_timeout_s + peer.gap_s
                self._asked.append(Question(each.data, each.message, each.mismatch, until))
            # Replies of other drives are known by their addresses.
            self._drives[f"{each.protocol}:{getattr(each.message, 'address', '')}"] = now
        was_shared = self.shared(now)
        self._heard_at.append(now)
        self.careful_until = max(self.careful_until, now + SHARED_S)
        if len(self._heard_at) == EVIDENCE and now - self._heard_at[0] < SHARED_S:
            self._shared_until = now + SHARED_S
            if self._on_shared is not None and not was_shared:
                self._on_shared(SHARED)


class _Tongue(NamedTuple):
    """A protocol that is spoken on a line."""

    protocol: str
    codec: Codec
    mismatch: Callable[[Message, Message], str]


class _Reading(NamedTuple):
    """What bytes are as a telegram of one protocol and direction."""

    data: bytes
    direction: Direction
    message: Message
    mismatch: Callable[[Message, Message], str]
    protocol: str


def _telegrams(data: bytes, tongues: Iterable[_Tongue]) -> Iterator[list[_Reading]]:
    """Yield the sound telegrams in some bytes, in order, each as all that it can be."""
    found: dict[tuple[int, int], list[_Reading]] = {}
    for tongue in tongues:
        directions: tuple[Direction, ...] = ("request", "reply")
        for direction in directions:
            framer, place = Framer(tongue.codec, direction), 0
            for find in (*framer.feed(data), *framer.flush()):
                if isinstance(find, Framed):
                    end = place + len(find.data)
                    if len(find.data) >= SHORTEST_EVIDENCE:
                        # The longest first where several begin at one place.
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
