"""Checks of a master's timing and line settings, transmission by transmission."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.protocol import SETTING_NAMES, Framed, Framer, LineSettings, is_broadcast
from drivecomm.virtual.line_rules import DEFAULT, LineRules, TimeLimit, Violation, codec_key, in_ms

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from typing import Any

    from drivecomm.protocol import Message
    from drivecomm.virtual.line_rules import Rule
    from drivecomm.virtual.medium import Transmission

# Times are sums of floats, so they are compared with this tolerance.
_EXACT_S = 1e-6
_LONGEST_TELEGRAM = 1024
_ABANDONED_S = 2.0
"""Length of a pause, in seconds, after which an incomplete telegram counts as abandoned, not as one with a gap."""

SERVED_TOLERANCE_S = 0.020
"""Largest delay, in seconds, with which a process may read data from a line that is served in real time."""

_SEEN = "seen on the line"
"""Source of a limit for a reply that was certainly due, whatever a manual says."""


def violations(
    transmissions: Iterable[Transmission], drives: Iterable[LineRules], *, tolerance_s: float = 0.0
) -> Iterator[Violation]:
    """Yield the violations by a master, in the order of its telegrams; see `TimingWatch`."""
    watch = TimingWatch(drives, tolerance_s=tolerance_s)
    for sent in transmissions:
        yield from watch.take(sent)


@dataclass(slots=True)
class _Piece:
    """Bytes of a telegram that a master sent in one piece."""

    sent: Transmission
    first: int
    length: int

    @property
    def began(self) -> float:
        return self.sent.began + self.sent.settings.wire_s(self.first) * self._takes_time

    @property
    def ended(self) -> float:
        """The earliest time at which its last byte has been sent."""
        return self.began + self.sent.settings.wire_s(self.length) * self._takes_time

    @property
    def out(self) -> float:
        """The time at which its last byte has been sent on a line with character times."""
        return self.began + self.sent.settings.wire_s(self.length)

    @property
    def _takes_time(self) -> bool:
        return self.sent.ended > self.sent.began


@dataclass(slots=True)
class _Request:
    """The request whose reply is awaited, or the broadcast after which a pause is due."""

    drive: LineRules
    began: float
    ended: float


class _Measured(NamedTuple):
    """A measured time that a rule limits. tolerance_s: None for the tolerance of the watch."""

    rule: Rule
    drive: LineRules
    at_s: float
    seconds: float
    text: str
    tolerance_s: float | None = None


class TimingWatch:
    """Watch of the timing and line settings of one line's master.

    It needs the master's transmissions when they are handed over, and the drives' when they end. The former come from a
    line's `on_transmit`, because the sender is not responsible for what the wire or a fault makes of a request. A
    transmission without a duration, on a line that is not paced, gets the time of its characters if that favours the
    master. tolerance_s: largest error of the times, as on a served line; a pause after a reply needs none, because it
    can only be measured too long. Its memory does not grow.
    """

    def __init__(self, drives: Iterable[LineRules], *, tolerance_s: float = 0.0) -> None:
        self._drives = tuple(drives)
        self._tolerance_s = tolerance_s
        self._codecs = {codec_key(rules.codec): rules.codec for rules in self._drives}
        self._of_kind: dict[Any, list[LineRules]] = {}
        for rules in self._drives:
            self._of_kind.setdefault(codec_key(rules.codec), []).append(rules)
        self._pieces: list[_Piece] = []
        self._due: _Request | None = None
        self._replied: _Request | None = None
        self._told: _Request | None = None
        self._asked_at: dict[str, float] = {}
        self._wrong_settings: tuple[str, str] | None = None
        self._renew()

    def take(self, sent: Transmission) -> list[Violation]:
        """Return the violations by the master in this transmission."""
        if sent.source == "master":
            return list(self._requested(sent))
        if sent.source == "drive":
            self._replies(sent)
        return []

    def _begin_anew(self) -> None:
        """Discard an incomplete telegram."""
        self._pieces.clear()
        self._renew()

    def _renew(self) -> None:
        self._framers = {alike: Framer(codec, "request") for alike, codec in self._codecs.items()}

    def _replies(self, sent: Transmission) -> None:
        if self._pieces and self._pieces[-1].began <= sent.began:
            # A drive has understood the bytes, so they were not the beginning of a telegram.
            self._begin_anew()
        due, sender = self._due, sent.sender
        if due is None or sent.began < due.began or (sender is not None and sender.address != due.drive.address):
            return
        self._due = None
        self._replied = _Request(due.drive, sent.began, sent.ended)

    # Requests

    def _requested(self, sent: Transmission) -> Iterator[Violation]:
        """Yield the violations in the telegrams that this piece completes."""
        if self._pieces and sent.began - self._pieces[-1].out > _ABANDONED_S:
            self._begin_anew()
        self._pieces.append(_Piece(sent, 0, len(sent.data)))
        if not any(framer.begun for framer in self._framers.values()):
            del self._pieces[:-1]
        found: dict[Any, list[Framed]] = {
            alike: [find for find in framer.feed(sent.data) if isinstance(find, Framed)]
            for alike, framer in self._framers.items()
        }
        best = max(found, key=lambda alike: sum(len(find.data) for find in found[alike]), default=None)
        if best is None or not found[best]:
            if sum(piece.length for piece in self._pieces) > _LONGEST_TELEGRAM:
                self._begin_anew()
            return
        explained = sum(len(find.data) for find in found[best])
        if any(framer.held > explained for alike, framer in self._framers.items() if alike != best):
            # An apparent short telegram is part of a longer one of another protocol that is still incomplete.
            return
        rest = self._framers[best].held
        behind = rest + explained
        for find in found[best]:
            pieces = _cut(self._pieces, behind, behind - len(find.data))
            behind -= len(find.data)
            # Skip a telegram that ended in an earlier piece and was found late, behind stray bytes.
            if behind < len(sent.data):
                yield from self._judged(find.message, best, pieces)
        self._pieces = _cut(self._pieces, rest, 0)
        others = [framer for alike, framer in self._framers.items() if alike != best]
        if others:
            tail = sent.data[len(sent.data) - rest :]
            self._renew()
            for framer in self._framers.values():
                framer.feed(tail)

    def _judged(self, message: Message, alike: Any, pieces: Sequence[_Piece]) -> Iterator[Violation]:
        drive, is_meant = self._addressed(message, alike)
        if drive is None or not pieces:
            return
        first, last = pieces[0], pieces[-1]
        yield from self._settings([drive] if is_meant else self._drives, last.sent)
        yield from self._gaps(drive, pieces)
        yield from self._too_early(first)
        if is_meant:
            yield from self._too_often(drive, first)
        self._replied = self._told = self._due = None
        request = _Request(drive, first.began, last.ended)
        if is_broadcast(drive.plugin, message):
            self._told = request
        elif is_meant and message.kind not in drive.plugin.unanswered:
            self._due = request

    def _addressed(self, message: Message, alike: Any) -> tuple[LineRules | None, bool]:
        """Return the rules for a request, and whether they belong to the addressed drive on this line."""
        of_kind = self._of_kind.get(alike, [])
        address = getattr(message, "address", None)
        for each in of_kind:
            if each.address == address:
                return each, True
        return (of_kind[0] if of_kind else None), False

    def _too_early(self, first: _Piece) -> Iterator[Violation]:
        due, replied, told, at_s = self._due, self._replied, self._told, first.began
        if due is not None:
            waited = max(at_s - due.ended, 0.0)
            sure = _SEEN if first.sent.answer_due or not waited else ""
            text = "the next request began {measured} after the last one, whose reply was due and may take {allowed}"
            limits = [TimeLimit(limit.seconds, limit.source or sure) for limit in due.drive.reply_timeouts]
            yield from self._short(_Measured("reply not awaited", due.drive, at_s, waited, text), limits)
        elif replied is not None:
            pause_s = max(at_s - replied.ended, 0.0)
            text = "the next request began {measured} after the end of its reply; it must leave {allowed}"
            measured = _Measured("turnaround", replied.drive, at_s, pause_s, text, 0.0)
            yield from self._short(measured, replied.drive.turnarounds)
        elif told is not None:
            text = "the next request began {measured} after the end of a broadcast; it must leave {allowed}"
            measured = _Measured("pause after a broadcast", told.drive, at_s, at_s - told.ended, text)
            yield from self._short(measured, told.drive.broadcast_pauses)

    def _too_often(self, drive: LineRules, first: _Piece) -> Iterator[Violation]:
        before = self._asked_at.get(drive.name)
        self._asked_at[drive.name] = first.began
        if before is not None:
            text = "a request began {measured} after the beginning of the last one; it must leave {allowed}"
            measured = _Measured("request interval", drive, first.began, first.began - before, text)
            yield from self._short(measured, drive.intervals)

    def _gaps(self, drive: LineRules, pieces: Sequence[_Piece]) -> Iterator[Violation]:
        pauses = [(later.began - earlier.out, later.began) for earlier, later in pairwise(pieces)]
        longest_s, at_s = max(pauses, default=(0.0, 0.0))
        if longest_s > drive.gap.seconds + self._tolerance_s + _EXACT_S:
            text = "a request had a pause of {measured} inside it; it may have {allowed}"
            yield self._violation(_Measured("gap in a telegram", drive, at_s, longest_s, text), drive.gap)

    def _short(self, measured: _Measured, limits: Iterable[TimeLimit]) -> Iterator[Violation]:
        """Yield a violation if a time is shorter than a limit, preferring a limit that a source demands."""
        tolerance_s = self._tolerance_of(measured)
        broken = [limit for limit in limits if measured.seconds < limit.seconds - tolerance_s - _EXACT_S]
        if broken:
            yield self._violation(measured, max(broken, key=lambda limit: (bool(limit.source), limit.seconds)))

    def _tolerance_of(self, measured: _Measured) -> float:
        return self._tolerance_s if measured.tolerance_s is None else measured.tolerance_s

    def _violation(self, measured: _Measured, limit: TimeLimit) -> Violation:
        return Violation(
            rule=measured.rule,
            at_s=measured.at_s,
            measured=measured.seconds,
            allowed=limit.seconds,
            source=limit.source or DEFAULT,
            demanded=bool(limit.source),
            drive=measured.drive.name,
            protocol=measured.drive.plugin.name,
            text=measured.text.format(measured=in_ms(measured.seconds), allowed=in_ms(limit.seconds)),
            tolerance_s=self._tolerance_of(measured),
        )

    # Line settings

    def _settings(self, drives: Sequence[LineRules], sent: Transmission) -> Iterator[Violation]:
        """Yield a violation if none of these drives has the line settings; only once until something changes."""
        told, drive = sent.told_settings, drives[0]
        if not told or any(each.listens_with(told) for each in drives):
            self._wrong_settings = None
            return
        shown, allowed = _shown(told), str(drive.facts.settings)
        if (shown, drive.name) == self._wrong_settings:
            return
        self._wrong_settings = shown, drive.name
        sources = dict.fromkeys(drive.sources[name] for name in told if name in drive.sources)
        yield Violation(
            rule="line settings",
            at_s=sent.began,
            measured=shown,
            allowed=allowed,
            source=", ".join(sources) or "what the drive is set to",
            demanded=True,
            drive=drive.name,
            protocol=drive.plugin.name,
            text=f"the master sent with {shown}, but the drive uses {allowed}{_unseen(told)}",
        )


def _cut(pieces: Sequence[_Piece], first: int, last: int) -> list[_Piece]:
    """Return the parts of pieces that hold the characters from first to last, both counted from the end."""
    if len(pieces) == 1 and last == 0 and first == pieces[0].length:
        return [*pieces]
    parts, behind = [], 0
    for piece in reversed(pieces):
        begins, ends = min(first, behind + piece.length), max(last, behind)
        if begins > ends:
            parts.append(replace(piece, first=piece.first + behind + piece.length - begins, length=begins - ends))
        behind += piece.length
    return parts[::-1]


def _shown(told: Mapping[str, Any]) -> str:
    if _unseen(told):
        return f"{told['baudrate']} baud and {'one stop bit' if told['stopbits'] == 1 else 'two stop bits'}"
    return str(LineSettings(**told))


def _unseen(told: Mapping[str, Any]) -> str:
    """Return a note on the line settings that are not visible; empty if all are."""
    if set(told) == set(SETTING_NAMES):
        return ""
    return "; a pseudo-terminal does not show data bits and parity, listen at rfc2217 for these"
