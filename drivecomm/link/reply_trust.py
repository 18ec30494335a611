"""Judgement of replies that fit a request: each could belong to another master, or a second one could contradict it.

A reply that names nothing of its request could be the reply to another master. If that is known to happen, or if a
reply comes sooner than this drive has answered so far, the link listens on until the drive's own reply would have come.
Two replies that differ count as no reply.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DoubtfulReplyError
from drivecomm.link.other_masters import MAY_BE_ANOTHERS, STRAGGLING_S, OpenRequest

if TYPE_CHECKING:
    from drivecomm.link.call_context import CallContext
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import DriveRecord, Peer
    from drivecomm.protocol import Ask, Framed

_SPREAD_S = 0.0005
_SPREAD = 0.05
"""Variation of a drive's reply time: a fixed part in seconds, and a share of the reply time."""
_MOST_DOUBTS = 8
"""Maximum number of times that a request is sent again because its reply is doubtful."""

_PATIENCE_S = 0.005
"""Time in seconds to listen for a second reply after the latest time of a drive; twice the spread is added."""
STRAY_CHARACTERS = 1
"""Maximum number of stray characters before a one-character reply that is still believed.

A transmitter produces one such character when it is switched on.
"""
BY_CHANCE = "one character among others, which may be there by chance"
_WHOSE = "replies cannot be matched to requests"


@dataclass(slots=True)
class FittingReply:
    """A reply that fits its request.

    at: time when it was complete. until: time until which to listen for another reply. doubt: why it may belong to
    another request; empty if it is certain. listened_out: whether it is accepted only when no other reply can come any
    more.
    """

    find: Framed
    at: float
    until: float
    doubt: str = ""
    listened_out: bool = False

    def compare(self, call: CallContext, data: bytes, other: Framed) -> None:
        """Compare another reply that fits; it may answer a later request of another master."""
        line, peer = call.line, call.peer
        line.judge(peer, data)
        if other.data != self.find.data and not line.others.may_have_requested(data, other.message, line.now):
            self.doubt = f"{peer.name} was asked once, but two different replies came"
        line.others.pass_by(other.data)

    def taken(self, call: CallContext, data: bytes) -> Framed:
        """Return the reply after listening has ended. Raises DoubtfulReplyError if it is in doubt."""
        line, peer, record, find = call.line, call.peer, call.record, self.find
        if self.doubt:
            line.others.may_be_answered_by(find.message)
            line.judge(peer, data)
            raise DoubtfulReplyError(f"{self.doubt}; {_WHOSE}")
        record.last = data, find.data
        line.judge(peer, data)
        if self.listened_out and not (record.may_be_late(line.now) or line.others.heard_lately(line.now)):
            took_s = reply_lag_s(self.at - line.sent_at, find.data, _paced(call))
            record.answered_after(took_s, _spread_s(call, took_s))
        note_reply(line, peer, record, len(find.data), self.at)
        line.note(peer, "received", find.data, find.message)
        return find


class ReplyVote:
    """Replies to one request of ours, among which may be late replies to earlier requests.

    doubts: number of times that the request was sent again. If N late replies may still come, then among N + 1 equal
    replies there is one to this request.
    """

    def __init__(self, call: CallContext, ask: Ask, data: bytes) -> None:
        self.doubts = 0
        self._call, self._ask, self._data = call, ask, data
        self._counted: Counter[bytes] = Counter()

    def may_ask_again(self) -> bool:
        """Return whether the request may be sent once more; if so, count the repetition."""
        call = self._call
        if self._ask.attempts == 1 or self.doubts == _MOST_DOUBTS:
            return False
        if call.line.now >= call.deadline or call.yields_to_others():
            return False
        self.doubts += 1
        return True

    def is_certain(self, found: Framed) -> bool:
        """Return whether a reply is certain enough to be accepted; if not, the request must be sent again.

        Raises DoubtfulReplyError if it cannot be sent again, and only its reply can confirm it (`Ask.unseen`).
        """
        line, peer, record, ask = self._call.line, self._call.peer, self._call.record, self._ask
        if ask.nameless and line.others.uses_drive(peer.name, line.now):
            line.doubt = MAY_BE_ANOTHERS
        if not (record.still_owes(line.now) or self._counted) or not ask.nameless:
            return True
        self._counted[found.data] += 1
        # Different replies show that a late one came, so one more reply to this request may also come late.
        until = line.sent_at + peer.facts.timing.late_s + STRAGGLING_S if len(self._counted) > 1 else line.now
        asked = OpenRequest(self._data, ask.message, peer.mismatch, until)
        rivals = record.late_rivals(asked, found.message)
        same, all_of_them = self._counted[found.data], self._counted.total()
        # A reply that seems late may be a copy of the last one, so all different replies count as rivals, too.
        if same > max(rivals, all_of_them - same) or (ask.acts and not ask.unseen):
            return True
        # More replies than rivals: one of them confirms the repeated command, whatever it contains.
        if ask.acts and all_of_them > rivals:
            return True
        record.count["doubtful"] += 1
        if self.may_ask_again():
            return False
        if ask.unseen:
            raise DoubtfulReplyError(f"{peer.name} answered late before; {_WHOSE}")
        line.doubt = f"{peer.name} answered late before, and does not repeat the same reply"
        return True


def judge_reply(call: CallContext, ask: Ask, data: bytes, find: Framed, *, in_haste: bool) -> FittingReply:
    """Return a fitting reply with its doubt and the time to listen for others.

    in_haste: do not listen for other replies.
    """
    line, peer, record, now = call.line, call.peer, call.record, call.line.now
    line.judge(peer, data)
    doubt = ""
    if line.others.may_have_requested(data, find.message, now):
        doubt = f"another master asked {peer.name} at the same time"
    took_s = reply_lag_s(now - line.sent_at, find.data, _paced(call))
    is_sure = not ask.nameless or (now >= line.others.careful_until and took_s >= record.soonest_s)
    if in_haste or ask.acts or is_sure:
        # The only check of a single character is the silence after it.
        alone_s = 2 * _paced(call) if len(find.data) == 1 and not in_haste else 0.0
        return FittingReply(find, now, now + alone_s, doubt)
    latest_s = record.latest_s
    if latest_s == float("-inf"):
        latest_s = min(peer.gap_s, peer.facts.timing.reply_timeout_s)
    until = min(line.sent_at + latest_s + _paced(call) + _PATIENCE_S + 2 * _spread_s(call, latest_s), call.deadline)
    return FittingReply(find, now, max(now, until), doubt, listened_out=True)


def reply_lag_s(took_s: float, reply: bytes, character_s: float) -> float:
    """Return the delay until a reply began, given the delay until it was complete.

    character_s: time of one character; 0 if the port is not paced.
    """
    return took_s - len(reply) * character_s


def note_reply(line: LineState, peer: Peer, record: DriveRecord, length: int, came_at: float) -> None:
    """Record the reply to the last request. length: its number of characters. came_at: time when it was complete."""
    line.free_at = came_at + peer.turnaround_s
    took_s = came_at - line.sent_at
    record.statistics.reply_times.add(took_s)
    line.delays.answered(peer.protocol, took_s - length * peer.character_s)


def _paced(call: CallContext) -> float:
    return call.peer.character_s if call.paced else 0.0


def _spread_s(call: CallContext, lag_s: float) -> float:
    """Return the variation of the reply time of a drive that has answered after `lag_s`."""
    line, peer = call.line, call.peer
    # Without pacing, the time at which the request was on the wire is only assumed.
    about_s = lag_s if call.paced else lag_s + line.sent_at - call.record.asked_at
    return _SPREAD_S + _SPREAD * max(0.0, about_s, peer.character_s)
