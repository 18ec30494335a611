"""Directions of telegrams, inferred from the earlier telegrams of the same protocol.

Requests and replies of some protocols look alike. These observations count, each with a weight:

- A reply comes soon after a request that it answers (the protocol's `mismatch` decides), or late after one that had no
  answer.
- A request is repeated, byte for byte; a reply may be, too.
- A telegram without a request that it could answer is probably a request.
- After a silence longer than the reply timeout, a request is due.
- Some bytes recently always differed between this drive's requests and its replies; in these bytes the telegram is like
  one of the two.

A telegram that repeats the request before it, or that was recently heard in both directions, shows nothing by its
bytes: a drive may answer a request with the same bytes. It is a reply if it comes as soon as other replies on this line
do, if their usual delay is known.

A telegram that may be the late answer to an unanswered request is judged by its bytes alone, because a silence before
it shows nothing. If the bytes show nothing either, its direction stays open.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.protocol import is_broadcast

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.protocol import Direction, Message, Parity, Protocol
    from drivecomm.traffic.sniffer.readings import TelegramReading

_ANSWERS_NOW = 4
_REPEATED = 3
_NOTHING_ASKED = 2
_AFTER_SILENCE = 3
_ALIKE, _MOST_ALIKE = 2, 6
# Fewer matching bytes than this do not outweigh an open request.
_FEW = _ANSWERS_NOW // _ALIKE

# Bad lines and their adapters can delay a reply more than any drive does.
_LATEST_S = 2.0
# After this many undecided telegrams without a reply no such drive exists, and these are requests to it.
_MOST_DOUBTS = 3

_KEPT_REQUESTS = 8
_KEPT_EXAMPLES = 6
_KEPT_ENDS = 4
_KEPT_DELAYS = 9
# A usual reply takes between half and twice the usual time; many adapters add some milliseconds.
_AS_USUAL, _STEP_S = 2, 0.005


def wants_reply(protocol: Protocol, request: Message) -> bool:
    """Whether a request calls for an answer; other requests only end the exchange before."""
    return protocol.intent is not None and protocol.intent(request).access != ""


class Observation(NamedTuple):
    """A telegram on the line: its readings, one for each possible direction, and its times.

    behind_others: whether the telegram before it belonged to another protocol.
    """

    readings: Sequence[TelegramReading]
    began_s: float
    ended_s: float
    silence_s: float
    behind_others: bool = False

    def reading(self, direction: Direction) -> TelegramReading | None:
        """Return the reading in this direction; None if there is none."""
        for reading in self.readings:
            if reading.direction == direction:
                return reading
        return None


class _Asked(NamedTuple):
    message: Message
    data: bytes
    ended_s: float
    answered: bool = False


class _Examples:
    """The latest different telegrams of one length from or to one drive."""

    def __init__(self, kept: Iterable[bytes] = ()) -> None:
        self.kept = deque(kept, maxlen=_KEPT_EXAMPLES)
        self._columns: list[frozenset[int]] | None = None

    def add(self, data: bytes) -> None:
        """Keep a telegram unless it is already kept."""
        if data not in self.kept:
            self.kept.append(data)
            self._columns = None

    @property
    def columns(self) -> list[frozenset[int]]:
        """The set of bytes seen at each position."""
        if self._columns is None:
            self._columns = [frozenset(column) for column in zip(*self.kept, strict=True)]
        return self._columns


@dataclass(slots=True)
class DirectionEstimator:
    """Estimator of the directions of one protocol's telegrams on one line, from earlier telegrams."""

    protocol: Protocol
    _asked: deque[_Asked] = field(default_factory=lambda: deque(maxlen=_KEPT_REQUESTS))
    _examples: dict[tuple[object, int, Direction], _Examples] = field(default_factory=dict)
    _ends: dict[type[Message], deque[bool]] = field(default_factory=dict)
    certain: bool = False
    """Whether the directions of the earlier telegrams are certain."""
    spoken: bool = False
    """Whether any telegram of this protocol has been heard."""
    parity: Parity | None = None
    """Parity received as the eighth bit of the last telegram; None before the first telegram."""
    _just_answered: type[Message] | None = None
    _misheard_s: float = -inf
    _doubts: dict[object, int] = field(default_factory=dict)
    _delays: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_DELAYS))
    _compared: tuple[Message, Message, bool] | None = None
    _timeout_s: float = field(init=False)
    _too_late_s: float = field(init=False)

    def __post_init__(self) -> None:
        timing = self.protocol.facts.timing
        self._timeout_s = timing.reply_timeout_s
        self._too_late_s = timing.reply_timeout_s + timing.late_s

    def copy(self) -> DirectionEstimator:
        """Return an independent copy."""
        return replace(
            self,
            _asked=self._asked.copy(),
            _examples={key: _Examples(known.kept) for key, known in self._examples.items()},
            _ends={kind: known.copy() for kind, known in self._ends.items()},
            _doubts=self._doubts.copy(),
            _delays=self._delays.copy(),
        )

    def direction_of(self, heard: Observation) -> Direction | None:
        """Return the likelier direction of a telegram; None when both are equally likely."""
        if len(heard.readings) == 1:
            return heard.readings[0].direction
        request, reply = heard.reading("request"), heard.reading("reply")
        if request is None or reply is None:
            return "reply" if request is None else "request"
        if self.expects(reply, heard.began_s, heard.silence_s):
            return "reply"
        answered = reply.data in self._known(reply, "reply")
        asked = request.data in self._known(request, "request")
        if asked and not answered and (not self._asked or self._asked[-1].answered):
            # Nothing suggests a reply.
            return "request"
        if (told := self._by_its_time(heard, reply, answered=answered)) is not None:
            return told
        balance = _REPEATED * answered - _REPEATED * asked
        balance -= self._likeness(request)
        if not self._may_be_late(heard, reply):
            balance += self._timeliness(heard, reply)
        if balance == 0:
            return None
        return "reply" if balance > 0 else "request"

    def expects(self, reply: TelegramReading, began_s: float, silence_s: float) -> bool:
        """Whether this reply answers the last request in time and does not look more like a request."""
        last = self._asked[-1] if self._asked else None
        if last is None or last.answered or last.data == reply.data:
            return False
        if began_s - last.ended_s > self._timeout_s or silence_s > self._timeout_s:
            return False
        if not self._belong(last.message, reply.message):
            return False
        requests = self._examples_of(reply, "request")
        if requests is None:
            return True
        if reply.data in requests.kept:
            return False
        return not self._differs_as(requests, reply) or self._likeness(reply) < _ANSWERS_NOW

    @property
    def awaits_any(self) -> bool:
        """Whether the directions on this line are certain and the last request has no reply yet."""
        return self.certain and bool(self._asked) and not self._asked[-1].answered

    def doubt(self, heard: Observation) -> None:
        """Record a telegram whose direction stays open."""
        address = getattr(heard.readings[0].message, "address", None)
        self._doubts[address] = self._doubts.get(address, 0) + 1

    def take(self, reading: TelegramReading, began_s: float, ended_s: float) -> None:
        """Record a telegram with a known direction."""
        self.spoken = True
        data, direction = reading.data, reading.direction
        if not reading.short:
            self.parity = reading.parity
        elif direction == "request" and not wants_reply(self.protocol, reading.message):
            return
        address = getattr(reading.message, "address", None)
        examples = self._examples.get((address, len(data), direction))
        if examples is None:
            examples = self._examples[address, len(data), direction] = _Examples()
        examples.add(data)
        if direction == "request":
            for earlier in self._asked:
                if not earlier.answered and earlier.data == data:
                    # A repeated request has one answer, not two.
                    self._asked.remove(earlier)
                    break
            self._asked.append(_Asked(reading.message, data, ended_s))
            self._end(closed=False)
            return
        if self._doubts:
            self._doubts.pop(address, None)
        self._just_answered = type(self._asked[-1].message) if self._asked else None
        if (place := self._answered_by(reading.message, ended_s)) is not None:
            asked = self._asked[place]
            self._asked[place] = _Asked(asked.message, asked.data, asked.ended_s, answered=True)
            if place == len(self._asked) - 1 and asked.data != reading.data:
                self._delays.append(began_s - asked.ended_s)

    def awaits(self, reply: Message, began_s: float) -> bool:
        """Whether the last request is unanswered and this message can be its reply."""
        last = self._asked[-1] if self._asked else None
        return last is not None and not last.answered and self._may_answer(last, reply, began_s)

    def may_come(self, reading: TelegramReading, began_s: float) -> bool:
        """Whether a reply is plausible: it answers an open or damaged request, or repeats a recent reply."""
        if began_s - self._misheard_s <= self._timeout_s and self._knows(reading.message):
            return True
        return any(
            (not asked.answered or reading.data in self._known(reading, reading.direction))
            and self._may_answer(asked, reading.message, began_s)
            for asked in self._asked
        )

    def awaited(self, now_s: float) -> Message | None:
        """Return the request whose reply is due now; None if no reply is due."""
        last = self._asked[-1] if self._asked else None
        late = last is None or last.answered or now_s - last.ended_s > self._timeout_s
        return None if late or last is None or is_broadcast(self.protocol, last.message) else last.message

    def leaves_unanswered(self, request: TelegramReading) -> bool:
        """Whether the last request has no answer and this request differs from it."""
        last = self._asked[-1] if self._asked else None
        if last is None or last.answered or is_broadcast(self.protocol, last.message):
            return False
        return last.data != request.data

    def mishear(self, ended_s: float) -> None:
        """Record a damaged request, which its drive may refuse."""
        self._misheard_s = ended_s

    def close(self) -> None:
        """Record that a telegram of one character, or a broken request, followed the last reply."""
        self._end(closed=True)

    @property
    def has_just_answered(self) -> bool:
        """Whether the last telegram of this protocol was the reply to a request."""
        return self._just_answered is not None

    @property
    def closes_often(self) -> bool:
        """Whether a closing character is due, because half of the similar exchanges ended with one.

        Exchanges of the same kind as the last one count; if none of that kind has ended yet, those of all kinds count.
        """
        if self._just_answered is None:
            return False
        ends = self._ends.get(self._just_answered) or [end for known in self._ends.values() for end in known]
        return sum(ends) * 2 >= len(ends)

    def plausibility(self, heard: Observation) -> int:
        """Return a score: 2 if the telegram answers the last request, 1 if its drive is known, else 0."""
        reply = heard.reading("reply")
        if reply is not None and self.awaits(reply.message, heard.began_s):
            return 2
        return 1 if any(self._knows(reading.message) for reading in heard.readings) else 0

    def _knows(self, message: Message) -> bool:
        """Whether a telegram of this message's drive has been heard."""
        named = getattr(message, "address", None)
        return any(address == named for address, _, _ in self._examples)

    def _end(self, *, closed: bool) -> None:
        if self._just_answered is not None:
            self._ends.setdefault(self._just_answered, deque(maxlen=_KEPT_ENDS)).append(closed)
        self._just_answered = None

    def _may_be_late(self, heard: Observation, reply: TelegramReading) -> bool:
        """Whether this may be a late reply to an earlier request; False for a drive that never answers."""
        if self._doubts.get(getattr(reply.message, "address", None), 0) >= _MOST_DOUBTS:
            return False
        timeout_s = self._timeout_s
        for asked in reversed(self._asked):
            if asked.answered:
                continue
            passed_s = heard.began_s - asked.ended_s
            if passed_s > self._latest_s:
                return False
            if asked.data == reply.data or not self._belong(asked.message, reply.message):
                continue
            return passed_s > timeout_s or asked is not self._asked[-1]
        return False

    def _by_its_time(self, heard: Observation, reply: TelegramReading, *, answered: bool) -> Direction | None:
        """Infer the direction of a telegram from its time, if its bytes do not show it.

        Return None if its bytes show the direction, or if no usual reply time is known.
        """
        last = self._asked[-1] if self._asked else None
        if last is None or not self._delays:
            return None
        both_ways = answered and reply.data in self._known(reply, "request")
        if not both_ways and (last.answered or last.data != reply.data):
            return None
        usual_s = sorted(self._delays)[len(self._delays) // 2]
        # With no delay at all, the telegram was sent twice, or the data was delivered in one step.
        if usual_s <= 0:
            return None
        if usual_s / _AS_USUAL <= heard.began_s - last.ended_s <= _AS_USUAL * usual_s + _STEP_S:
            return "reply" if self.awaits(reply.message, heard.began_s) else "request"
        return None if self._may_be_late(heard, reply) else "request"

    def _timeliness(self, heard: Observation, reply: TelegramReading) -> int:
        """Return a weight for the pauses: above 0 for a reply, below 0 for a request."""
        timeout_s = self._timeout_s
        due = self.awaits(reply.message, heard.began_s)
        prompt = due and self._asked[-1].data != reply.data and heard.began_s - self._asked[-1].ended_s <= timeout_s
        weight = _ANSWERS_NOW * prompt - _NOTHING_ASKED * (not due)
        return weight - _AFTER_SILENCE * (heard.silence_s > timeout_s)

    @property
    def _latest_s(self) -> float:
        return max(_LATEST_S, self._too_late_s)

    def _answered_by(self, reply: Message, ended_s: float) -> int | None:
        for place in range(len(self._asked) - 1, -1, -1):
            asked = self._asked[place]
            if not asked.answered and self._may_answer(asked, reply, ended_s):
                return place
        return None

    def _may_answer(self, asked: _Asked, reply: Message, now_s: float) -> bool:
        return now_s - asked.ended_s <= self._too_late_s and self._belong(asked.message, reply)

    def _belong(self, request: Message, reply: Message) -> bool:
        """Whether this reply answers this request; the last result is cached because callers repeat the check."""
        known = self._compared
        if known is None or known[0] is not request or known[1] is not reply:
            known = self._compared = request, reply, not self.protocol.mismatch(request, reply)
        return known[2]

    def _known(self, reading: TelegramReading, direction: Direction) -> Iterable[bytes]:
        examples = self._examples_of(reading, direction)
        return () if examples is None else examples.kept

    def _examples_of(self, reading: TelegramReading, direction: Direction) -> _Examples | None:
        """Return recent telegrams of the same length to this drive, or from it, by direction."""
        return self._examples.get((getattr(reading.message, "address", None), len(reading.data), direction))

    def _differs_as(self, requests: _Examples, reply: TelegramReading) -> bool:
        """Whether enough of the bytes that differ from the previous reply occur in earlier requests."""
        replies = self._examples_of(reply, "reply")
        if replies is None:
            return False
        bytes_of_both = zip(reply.data, replies.kept[-1], requests.columns, strict=True)
        return len([byte for byte, before, asked in bytes_of_both if byte != before and byte in asked]) >= _FEW

    def _likeness(self, reading: TelegramReading) -> int:
        """Return a weight above 0 if the bytes match this drive's requests, below 0 for its replies, 0 if unclear."""
        requests, replies = self._examples_of(reading, "request"), self._examples_of(reading, "reply")
        if requests is None or replies is None:
            return 0
        like_requests = like_replies = 0
        # Leave out the last byte: a check depends on the other bytes.
        # Requests repeat, so their column sets are cached; replies seldom repeat.
        for byte, asked, answered in zip(
            reading.data[:-1], requests.columns, zip(*replies.kept, strict=True), strict=False
        ):
            if byte in answered:
                like_replies += byte not in asked and asked.isdisjoint(answered)
            elif byte in asked:
                like_requests += asked.isdisjoint(answered)
        # With few examples bytes differ by chance, so they count less for a telegram that is not among them.
        is_new = reading.data not in requests.kept and reading.data not in replies.kept
        most = min(_MOST_ALIKE, len(requests.kept), len(replies.kept)) if is_new else _MOST_ALIKE
        return max(-most, min(most, _ALIKE * (like_requests - like_replies)))
