"""Decoding of the telegrams of several protocols from one stream of bytes in both directions. No I/O, no clock.

At each position of the stream, the codecs of all protocols are tried in both directions. Each sound telegram is a
candidate. If candidates share bytes, more telegrams win over fewer, then those that fit the conversation and the
pauses. Two equally good readings are reported as ambiguous, without a guess.

Telegrams of one to three characters, such as an ACK, prove little. They are accepted only in a protocol that is spoken
on the line, if they stand alone or between sound telegrams. A reply must also be expected by a request. A request of
one character is accepted if such requests regularly end conversations, or if it requests more behind a reply that was
the last telegram on the line.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.traffic.sniffer.beginnings import Beginnings
from drivecomm.traffic.sniffer.damage import DamageReport
from drivecomm.traffic.sniffer.directions import DirectionEstimator, Observation, wants_reply
from drivecomm.traffic.sniffer.pending import PendingItems
from drivecomm.traffic.sniffer.readings import (
    Candidate,
    TelegramReader,
    TelegramReading,
    UnfinishedTelegram,
    choose,
    readers_of,
    without_ambiguous,
)
from drivecomm.traffic.sniffer.traffic_items import AmbiguousTelegram, ways_of
from drivecomm.traffic.sniffer.undecided_bytes import UndecidedBytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from drivecomm.capture import Piece, Source
    from drivecomm.protocol import Direction, LineSettings, Protocol
    from drivecomm.traffic.sniffer.traffic_items import TrafficItem

_SENDERS: dict[str, Direction] = {"master": "request", "drive": "reply"}
Belief: TypeAlias = Literal["yes", "no", "wait", "perhaps"]

# Unexplained bytes without a pause are reported in pieces of this size.
_LONGEST_UNKNOWN = 4096
# Number of readings with common bytes that are compared together; a chance reading seldom overlaps two others.
_TOGETHER = 16
# Penalty for a pause inside a telegram, see drivecomm.traffic.sniffer.readings.
_TORN = 6
# A character that is repeated this often is noise.
_MANY = 4
# Number of cached whole telegrams, and the length up to which a telegram is cached.
_MOST_KNOWN = 512
_LONGEST_KNOWN = 300


class Sniffer:
    """Decoder for the traffic of one line.

    protocols: protocols to look for; of two that declare each other ambiguous, only the first is used. settings: the
    line settings if known, for pieces without their own. options: drive options by protocol name, such as pnu_bits, if
    they differ from the protocol's defaults.

    Feed pieces in the order of their times, in any sizes. Items are returned once they are certain, in the order of the
    line. Call `flush` during silence, so that no item that only silence can end is held back, and `finish` at the end.
    """

    def __init__(
        self,
        protocols: Iterable[Protocol],
        *,
        settings: LineSettings | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        known = without_ambiguous(protocols)
        self._stretch = UndecidedBytes(settings.character_s if settings else None)
        self._estimators = {protocol.name: DirectionEstimator(protocol) for protocol in known}
        self._pending = PendingItems(self._estimators)
        options = options or {}
        self._beginnings = Beginnings(reader for each in known for reader in readers_of(each, options.get(each.name)))
        self._damage = DamageReport(self._stretch, self._estimators, self._beginnings.of)
        self._whole: dict[bytes, tuple[TelegramReading, ...]] = {}
        self._replies: dict[tuple[str, bytes], tuple[TelegramReading, ...]] = {}
        self._singles: dict[bytes, tuple[list[TelegramReading], frozenset[str]]] = {}
        self._longest_gap_s = max((protocol.facts.gap_s for protocol in known), default=0.0)
        self._shortest_gap_s = min((protocol.facts.gap_s for protocol in known), default=0.0)
        self._place = 0
        self._spoken_last = ""
        self._silence_s = 0.0

    def feed(self, piece: Piece) -> list[TrafficItem]:
        """Process bytes from the line and return the items that are now certain."""
        if not piece.data:
            return self.flush(piece.time_s)
        self._silence_s = 0.0
        stretch = self._stretch
        began_s, ended_s, silence_s = stretch.times_of(piece)
        if stretch.data:
            readings = self._readings_of_whole(piece.data, piece.source) if len(stretch.data) == 1 else ()
            if not readings or not self._decide_single(piece, silence_s):
                stretch.append(piece)
                self._search()
                return self._pending.certain()
        elif len(piece.data) == 1 and self._beginnings.may_go_on(piece.data):
            stretch.append(piece)
            return self._pending.certain()
        else:
            readings = self._expected(piece, began_s, silence_s) or self._readings_of_whole(piece.data, piece.source)
            if not readings:
                stretch.append(piece)
                self._search()
                return self._pending.certain()
        # The usual case: the piece is exactly one whole telegram.
        name, before = readings[0].protocol.name, self._spoken_last
        self._spoken_last = name
        stretch.pass_by(piece)
        return self._pending.hear_alone(Observation(readings, began_s, ended_s, silence_s, before not in ("", name)))

    def flush(self, now: float) -> list[TrafficItem]:
        """Return the items that are certain because the line has been silent up to this time."""
        self._silence_s = max(0.0, self._stretch.silence_after(now))
        self._search()
        return self._pending.certain()

    def finish(self) -> list[TrafficItem]:
        """Return all remaining items at the end of the traffic."""
        self._silence_s = inf
        self._search()
        self._pending.finish()
        return self._pending.certain()

    def _search(self) -> None:
        while self._place < len(self._stretch) and self._step():
            pass
        over = self._place == len(self._stretch) and self._silence_s > self._longest_gap_s
        if over or self._place > _LONGEST_UNKNOWN:
            self._report(self._place)

    def _expected(self, piece: Piece, began_s: float, silence_s: float) -> Sequence[TelegramReading]:
        """Return the reading of a piece that is exactly the reply to the last request; empty for any other piece."""
        name, data = self._spoken_last, piece.data
        if not name or piece.source == "master" or not (estimator := self._estimators[name]).awaits_any:
            return ()
        readings = self._replies.get((name, data))
        if readings is None:
            if len(self._replies) >= _MOST_KNOWN:
                self._replies.clear()
            readings = self._replies[name, data] = self._beginnings.whole_reply(name, data)
        if not readings:
            return ()
        return readings if estimator.expects(readings[0], began_s, silence_s) else ()

    def _decide_single(self, piece: Piece, silence_s: float) -> bool:
        """Classify a single character before a whole telegram; return whether it was removed."""
        if self._place or silence_s > self._shortest_gap_s:
            return False
        ways, unfinished = self._single_before(self._stretch.data, piece.data)
        readings = [each for each in ways if self._may_be_sent(each) and self._estimators[each.protocol.name].spoken]
        if len(readings) != 1 or any(self._estimators[name].spoken for name in unfinished):
            return False
        if self._estimators[readings[0].protocol.name].parity not in (None, readings[0].parity):
            return False
        return self._conclude(*self._most_due(readings))

    def _single_before(self, character: bytes, data: bytes) -> tuple[list[TelegramReading], frozenset[str]]:
        """Return the readings of a single character before this telegram, from a cache; see `Beginnings.single`."""
        both = character + data
        known = self._singles.get(both)
        if known is None:
            if len(self._singles) >= _MOST_KNOWN:
                self._singles.clear()
            known = self._singles[both] = self._beginnings.single(both)
        return known

    def _readings_of_whole(self, data: bytes, source: Source) -> Sequence[TelegramReading]:
        """Return the readings of a piece that is certainly one whole telegram of one protocol; empty for any other."""
        readings = self._whole.get(data)
        if readings is None:
            readings = self._beginnings.whole(data)
            if len(self._whole) >= _MOST_KNOWN:
                self._whole.clear()
            if len(data) <= _LONGEST_KNOWN:
                self._whole[data] = readings
        if source == "unknown":
            return readings
        return [reading for reading in readings if _SENDERS[source] == reading.direction]

    def _step(self) -> bool:
        """Classify one position; return False if more bytes are needed first."""
        place, stretch = self._place, self._stretch
        if place and stretch.silence_before(place) > self._longest_gap_s:
            self._report(place)
            return True
        if not self._beginnings.of(stretch.data[place]):
            self._place += 1
            return True
        if place and (behind := self._behind_repetitions(place)) > place:
            self._place = behind
            return True
        readings, waiting = self._readings_at(place, self._beginnings.of(stretch.data[place]))
        if long := [reading for reading in readings if not reading.short and self._may_begin_here(reading, readings)]:
            self._take_first_of(self._sharing_bytes(long))
        elif waiting:
            return False
        elif readings and place and stretch.silence_before(place) > stretch.quiet_s(place):
            # The bytes before it may be the damaged request that it answers.
            self._report(place)
        elif readings:
            readings, belief = self._belief(readings)
            if belief == "wait":
                return False
            self._conclude(readings, belief)
        else:
            self._place += 1
        return True

    def _conclude(self, readings: list[TelegramReading], belief: Belief) -> bool:
        """Accept or skip a short telegram according to the belief in it; return whether its bytes were removed."""
        if belief == "no":
            self._place += 1
        elif belief == "perhaps":
            self._take_as_ambiguous(readings)
        else:
            self._take(readings)
        return belief != "no"

    def _behind_repetitions(self, place: int) -> int:
        """Return the last position of a run of one byte, if only single characters can begin before it.

        A flood of equal bytes would otherwise cost more time than all else.
        """
        stretch, byte = self._stretch, self._stretch.data[place]
        if (
            not self._beginnings.ends_with(byte)
            or stretch.data[place + 1 : place + 2] != stretch.data[place : place + 1]
        ):
            return place
        same = len(stretch.data) - len(stretch.data[place:].lstrip(stretch.data[place : place + 1])) - 1
        pause_s = min(stretch.quiet_s(place), self._longest_gap_s)
        return min(same, stretch.unbroken_until(place, pause_s) - 1)

    def _readings_at(self, place: int, readers: Iterable[TelegramReader]) -> tuple[list[TelegramReading], bool]:
        """Return the sound telegrams that begin at a position, and whether more bytes may complete others."""
        stretch = self._stretch
        found, waiting = list[TelegramReading](), False
        data, silence_s = stretch.data, self._silence_s
        for reader in readers:
            limit = stretch.unbroken_until(place, reader.gap_s)
            if limit == len(data) and silence_s <= reader.gap_s:
                look = reader.look(data, place, limit)
            else:
                look = reader.look_at_rest(data, place, limit)
            if type(look) is TelegramReading:
                if (not look.short or self._estimators[look.protocol.name].spoken) and self._may_be_sent(look):
                    found.append(look)
            elif type(look) is UnfinishedTelegram:
                waiting = True
        return self._in_one_format(found) if found else found, waiting

    def _in_one_format(self, readings: list[TelegramReading]) -> list[TelegramReading]:
        """Return the readings without duplicates that differ only in their character format.

        A short telegram must have the format of the telegrams before it, because one wrong bit can look like parity.
        """
        kept: dict[tuple[str, Direction, int], TelegramReading] = {}
        for reading in readings:
            name = reading.protocol.name
            usual = self._estimators[name].parity
            if reading.short and usual not in (None, reading.parity):
                continue
            said = (name, reading.direction, reading.end)
            if said not in kept or reading.parity == usual:
                kept[said] = reading
        return list(kept.values())

    def _may_begin_here(self, reading: TelegramReading, others: list[TelegramReading]) -> bool:
        """Whether this is not a reply inside a damaged request, such as a VABus select without its EOT."""
        place, stretch = reading.start, self._stretch
        if not place or reading.direction == "request" or stretch.silence_before(place) > stretch.quiet_s(place):
            return True
        if any(other.direction == "request" for other in others):
            return True
        return self._estimators[reading.protocol.name].may_come(reading, stretch.began_s(place))

    def _may_be_sent(self, reading: TelegramReading) -> bool:
        source = self._stretch.source_of(reading.start, reading.end)
        return source is not None and _SENDERS.get(source, reading.direction) == reading.direction

    def _sharing_bytes(self, first: list[TelegramReading]) -> list[TelegramReading]:
        """Return these readings and all others that overlap them, directly or through further readings."""
        found = list(first)
        end = max(reading.end for reading in first)
        data, place = self._stretch.data, self._beginnings.next_place(self._stretch.data, first[0].start + 1, end)
        while place < end and len(found) < _TOGETHER:
            readings, _ = self._readings_at(place, self._beginnings.of_pair(data[place : place + 2]))
            inside = [reading for reading in readings if not reading.short]
            found += inside
            end = max([end, *(reading.end for reading in inside)])
            place = self._beginnings.next_place(data, place + 1, end)
        return found

    def _take_first_of(self, readings: list[TelegramReading]) -> None:
        by_place: dict[tuple[int, int, str], list[TelegramReading]] = {}
        for reading in readings:
            by_place.setdefault((reading.start, reading.end, reading.protocol.name), []).append(reading)
        if len(by_place) == 1:
            self._take(readings)
            return
        chosen = choose([Candidate(tuple(group), self._merit(group)) for group in by_place.values()])
        if chosen is None:
            self._take_as_ambiguous(readings)
        elif chosen[0].start > self._place:
            self._place = chosen[0].start
        else:
            self._take(list(chosen[0].readings))

    def _merit(self, readings: list[TelegramReading]) -> int:
        start, end = readings[0].start, readings[0].end
        estimator = self._estimators[readings[0].protocol.name]
        over = end == len(self._stretch) or self._stretch.silence_before(end) > self._stretch.quiet_s(end)
        begun = self._stretch.silence_before(start) > self._stretch.quiet_s(start)
        torn = self._stretch.unbroken_until(start, self._stretch.quiet_s(start)) < end
        return estimator.plausibility(self._heard(readings)) + begun + over - _TORN * torn

    def _belief(self, readings: list[TelegramReading]) -> tuple[list[TelegramReading], Belief]:
        """Return the plausible readings of a short telegram, and the belief that it is one."""
        if readings[0].start:
            return readings, "no"
        alone = self._stands_alone(readings[0].end)
        # A request damaged after its first character leaves that character behind.
        return self._most_due(readings) if alone == "yes" else (readings, alone)

    def _most_due(self, readings: list[TelegramReading]) -> tuple[list[TelegramReading], Belief]:
        """Return the readings of a lone short telegram in the protocol that most expects it, and the belief in them."""
        beliefs = [(reading, self._due(reading)) for reading in readings]
        for belief in ("yes", "perhaps"):
            if believed := [reading for reading, each in beliefs if each == belief]:
                names = {reading.protocol.name for reading in believed}
                name = self._spoken_last if self._spoken_last in names else believed[0].protocol.name
                return [reading for reading in believed if reading.protocol.name == name], belief
        return readings, "no"

    def _due(self, reading: TelegramReading) -> Belief:
        """Return the belief that a lone short telegram is due."""
        estimator = self._estimators[reading.protocol.name]
        if reading.direction == "reply":
            return "yes" if estimator.may_come(reading, self._stretch.began_s(reading.start)) else "no"
        if wants_reply(reading.protocol, reading.message):
            is_last = self._spoken_last == reading.protocol.name
            return "yes" if is_last and estimator.has_just_answered else "no"
        belief: Belief = "yes" if estimator.closes_often else "perhaps" if estimator.spoken else "no"
        estimator.close()
        return belief

    def _stands_alone(self, end: int) -> Belief:
        """Return the belief that silence or a telegram follows at this position."""
        stretch = self._stretch
        if end == len(stretch):
            return "yes" if self._silence_s > stretch.quiet_s(end) else "wait"
        if stretch.silence_before(end) > stretch.quiet_s(end):
            return "yes"
        following, waiting = self._readings_at(end, self._beginnings.of(stretch.data[end]))
        if following:
            # A run of the same character is noise, not one telegram after another.
            same = stretch.data[end - 1 : end] * _MANY == stretch.data[end - 1 : end - 1 + _MANY]
            return "no" if same and all(reading.short for reading in following) else "yes"
        return "wait" if waiting else "no"

    def _heard(self, readings: Sequence[TelegramReading]) -> Observation:
        start, end = readings[0].start, readings[0].end
        behind_others = self._spoken_last not in ("", readings[0].protocol.name)
        times = self._stretch.began_s(start), self._stretch.ended_s(end - 1), self._stretch.silence_before(start)
        return Observation(readings, *times, behind_others)

    def _take(self, readings: Sequence[TelegramReading]) -> None:
        heard = self._heard(readings)
        self._spoken_last = readings[0].protocol.name
        if self._place:
            self._report(self._place)
        self._forget(readings[0].end - readings[0].start)
        self._pending.hear(heard)

    def _take_as_ambiguous(self, readings: list[TelegramReading]) -> None:
        end = max(reading.end for reading in readings)
        data, time_s = self._stretch.data[self._place : end], self._stretch.ended_s(end - 1)
        self._report(self._place)
        self._forget(len(data))
        self._pending.add(AmbiguousTelegram(time_s=time_s, data=data, readings=ways_of(readings)))

    def _report(self, end: int) -> None:
        """Report the bytes before this position as damaged telegrams or unknown bytes."""
        for item in self._damage.items(end):
            self._pending.add(item)
        self._forget(end)

    def _forget(self, number: int) -> None:
        self._stretch.drop(number)
        self._place = 0
