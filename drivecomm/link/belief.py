"""Whether a reply that fits is believed: nobody else may have asked for it, and no other one may come beside it.

A reply that names nothing of its request could be the one to another master's. Where that is known to happen, and where
a reply comes sooner than this drive has answered so far, it is listened out: until the drive's own reply would have
come. Two replies that differ are no reply.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DoubtfulReplyError
from drivecomm.link.other_masters import MAY_BE_ANOTHERS, STRAGGLING_S, Question

if TYPE_CHECKING:
    from drivecomm.link.call import Call
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import Peer, PeerState
    from drivecomm.protocol import Ask, Framed

_SPREAD_S = 0.0005
_SPREAD = 0.05
"""By how much the times in which a drive answers may differ, as a time and as a share of it."""
_MOST_DOUBTS = 8
"""So often a question is asked again because its replies cannot be told from others."""

_PATIENCE_S = 0.005
"""What is listened for another reply beyond the latest time of a drive, twice the spread besides."""
STRAY_CHARACTERS = 1
"""Behind so many, such as a transmitter makes that is switched on, a reply of one character is still believed."""
BY_CHANCE = "one character among others, which may be there by chance"
_WHOSE = "which reply is whose cannot be told"


@dataclass(slots=True)
class Believed:
    """A reply that fits.

    at: when it had come. until: how long another one is listened for. doubt: why it may be another's. listened_out:
    whether it was taken only when no other one could come.
    """

    find: Framed
    at: float
    until: float
    doubt: str = ""
    listened_out: bool = False

    def compare(self, call: Call, data: bytes, other: Framed) -> None:
        """Take in one more reply that fits: it may answer what another master has asked since."""
        line, peer = call.line, call.peer
        line.judge(peer, data)
        if other.data != self.find.data and not line.others.may_have_asked_for(data, other.message, line.now):
            self.doubt = f"{peer.name} was asked once, and two replies came that differ"
        line.others.pass_by(other.data)

    def taken(self, call: Call, data: bytes) -> Framed:
        """Return the reply, now that all has been heard. Raises DoubtfulReplyError."""
        line, peer, partner, find = call.line, call.peer, call.partner, self.find
        if self.doubt:
            line.others.may_be_answered_by(find.message)
            line.judge(peer, data)
            raise DoubtfulReplyError(f"{self.doubt}; {_WHOSE}")
        partner.last = data, find.data
        line.judge(peer, data)
        if self.listened_out and not (partner.may_be_late(line.now) or line.others.heard_lately(line.now)):
            took_s = lag(self.at - line.sent_at, find.data, _paced(call))
            partner.answered_after(took_s, _spread_s(call, took_s))
        answered(line, peer, partner, len(find.data), self.at)
        line.note(peer, "received", find.data, find.message)
        return find


class Answers:
    """The answers to one question of ours, which may be late ones to others. doubts: how often it was asked again.

    Of as many equal answers as there are late replies to come, and one more, one is the answer to this question.
    """

    def __init__(self, call: Call, ask: Ask, data: bytes) -> None:
        self.doubts = 0
        self._call, self._ask, self._data = call, ask, data
        self._counted: Counter[bytes] = Counter()

    def may_ask_again(self) -> bool:
        """Whether the question may be asked once more; it is counted as that."""
        call = self._call
        if self._ask.attempts == 1 or self.doubts == _MOST_DOUBTS:
            return False
        if call.line.now >= call.deadline or call.others_first():
            return False
        self.doubts += 1
        return True

    def agree_on(self, found: Framed) -> bool:
        """Whether a reply is certain enough to be taken; the question is to be asked again otherwise."""
        line, peer, partner, ask = self._call.line, self._call.peer, self._call.partner, self._ask
        if ask.nameless and line.others.ask_too(peer.name, line.now):
            line.doubt = MAY_BE_ANOTHERS
        if not (partner.still_owes(line.now) or self._counted) or not ask.nameless:
            return True
        self._counted[found.data] += 1
        # Answers that differ show that a late one has come, and that one more of this question's may be late in turn.
        until = line.sent_at + peer.facts.timing.late_s + STRAGGLING_S if len(self._counted) > 1 else line.now
        asked = Question(self._data, ask.message, peer.mismatch, until)
        rivals = partner.late_rivals(asked, found.message)
        same, all_of_them = self._counted[found.data], self._counted.total()
        # What seems to have come late may have been the last reply once more, so the others count on.
        if same > max(rivals, all_of_them - same) or (ask.acts and not ask.unseen):
            return True
        # Whatever they say, one of so many replies confirms what was sent again and again.
        if ask.acts and all_of_them > rivals:
            return True
        partner.count["doubtful"] += 1
        if self.may_ask_again():
            return False
        if ask.unseen:
            raise DoubtfulReplyError(f"{peer.name} answered late before; {_WHOSE}")
        line.doubt = f"{peer.name} answered late before, and does not give the same answer twice"
        return True


def believed(call: Call, ask: Ask, data: bytes, find: Framed, *, in_haste: bool) -> Believed:
    """Return a reply that fits, as far as it can be believed now. in_haste: nothing more is listened for."""
    line, peer, partner, now = call.line, call.peer, call.partner, call.line.now
    line.judge(peer, data)
    doubt = ""
    if line.others.may_have_asked_for(data, find.message, now):
        doubt = f"another master asked {peer.name} at the same time"
    took_s = lag(now - line.sent_at, find.data, _paced(call))
    is_sure = not ask.nameless or (now >= line.others.careful_until and took_s >= partner.soonest_s)
    if in_haste or ask.acts or is_sure:
        # Nothing checks a single character but the silence behind it.
        alone_s = 2 * _paced(call) if len(find.data) == 1 and not in_haste else 0.0
        return Believed(find, now, now + alone_s, doubt)
    latest_s = partner.latest_s
    if latest_s == float("-inf"):
        latest_s = min(peer.gap_s, peer.facts.timing.reply_timeout_s)
    until = min(line.sent_at + latest_s + _paced(call) + _PATIENCE_S + 2 * _spread_s(call, latest_s), call.deadline)
    return Believed(find, now, max(now, until), doubt, listened_out=True)


def lag(took_s: float, reply: bytes, character_s: float) -> float:
    """Return after which time a reply began that was complete after this one. character_s: 0 where none is paced."""
    return took_s - len(reply) * character_s


def answered(line: LineState, peer: Peer, partner: PeerState, length: int, came_at: float) -> None:
    """Take note of the reply to the last request. length: its characters. came_at: when it had come."""
    line.free_at = came_at + peer.turnaround_s
    took_s = came_at - line.sent_at
    partner.statistics.reply_times.add(took_s)
    line.delays.answered(peer.protocol, took_s - length * peer.character_s)


def _paced(call: Call) -> float:
    return call.peer.character_s if call.paced else 0.0


def _spread_s(call: Call, lag_s: float) -> float:
    """Return by how much the times may differ in which a drive answers that has answered after this one."""
    line, peer = call.line, call.peer
    # Where nothing is paced, the time of the request on the wire is no more than an assumption.
    about_s = lag_s if call.paced else lag_s + line.sent_at - call.partner.asked_at
    return _SPREAD_S + _SPREAD * max(0.0, about_s, peer.character_s)
