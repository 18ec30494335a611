"""The trace of one virtual line, which is decoded when it is read."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter, deque
from dataclasses import dataclass
from math import inf
from operator import attrgetter
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.link import ARROWS, fields_text, hex_text, line_text
from drivecomm.protocol import Damaged, Framed, Framer
from drivecomm.virtual.line_rules import codec_key

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.protocol import Direction, Find, LineSettings
    from drivecomm.virtual.line import VirtualLine
    from drivecomm.virtual.line_rules import Violation
    from drivecomm.virtual.medium import Source, Transmission
    from drivecomm.virtual.violation_log import ViolationLog

_MOST_HEARD = 5000
_MOST_LINES = 80
_EXACT_S = 1e-6

_at_s = attrgetter("at_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedLine:
    """One line of a trace: a telegram, or bytes that are not a telegram.

    number: number of the transmission that ended it, counted from 1; several lines of one transmission share it.
    time_s: time of its first byte. meaning: kind and fields, or the error. remarks: further findings.
    """

    number: int
    time_s: float
    source: Source
    data: bytes
    meaning: str
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        arrow = ARROWS.get(self.source, "??")
        return line_text(self.time_s, arrow, hex_text(self.data), self.meaning, remarks=list(self.remarks))

    def as_object(self) -> dict[str, Any]:
        """Return the line as an object for JSON."""
        return {
            "number": self.number,
            "time_s": round(self.time_s, 6),
            "source": self.source,
            "data": hex_text(self.data),
            "telegram": self.meaning,
            "remarks": list(self.remarks),
        }


class _Numbered(NamedTuple):
    number: int
    sent: Transmission


class LineTrace:
    """The last 5000 transmissions on one line, recorded from now on and decoded only when they are read.

    violations: log whose entries become remarks at the requests concerned.
    """

    def __init__(self, line: VirtualLine, violations: ViolationLog) -> None:
        self.violations = violations
        self._drives = line.drives
        self._heard: deque[_Numbered] = deque(maxlen=_MOST_HEARD)
        self._number = 0
        self._counts: Counter[Source] = Counter()
        self._guard = Lock()
        line.recorders.append(self._add)

    def _add(self, sent: Transmission) -> None:
        with self._guard:
            self._number += 1
            self._counts[sent.source] += 1
            self._heard.append(_Numbered(self._number, sent))

    @property
    def counts(self) -> dict[Source, int]:
        """Number of transmissions by source."""
        with self._guard:
            return dict(self._counts)

    @property
    def first_kept(self) -> int:
        """Number of the first stored transmission; that of the next one if none is stored."""
        with self._guard:
            return self._heard[0].number if self._heard else self._number + 1

    def text(self) -> str:
        """Return the last 80 lines: time, direction, bytes and meaning of each telegram, and of other bytes."""
        lines = self.since(0)
        if not lines:
            return "no traffic on the line"
        left_out = len(lines) - _MOST_LINES
        head = [f"({left_out} earlier ones are left out)"] if left_out > 0 else []
        return "\n".join([*head, *map(str, lines[-_MOST_LINES:])])

    def since(self, number: int, *, ended_by: float = inf) -> list[TracedLine]:
        """Return all stored lines after the one with this number.

        ended_by: leave out the last telegram if it may continue after this time of the line.
        """
        with self._guard:
            heard = [each for each in self._heard if each.number > number]
        gap_s = max((drive.gap_s for drive in self._drives), default=0.0)
        groups = list(_joined(heard, gap_s))
        if groups and groups[-1][-1].sent.ended + gap_s > ended_by:
            del groups[-1]
        broken = sorted(self.violations.found, key=_at_s)
        return [line for together in groups for line in self._told(together, broken)]

    def _told(self, numbered: Sequence[_Numbered], broken: Sequence[Violation]) -> Iterator[TracedLine]:
        together = [each.sent for each in numbered]
        source, place = together[0].source, 0
        data = b"".join(heard.data for heard in together)
        remarks = self._remarks(together)
        for find in self._finds(data, "reply" if source == "drive" else "request"):
            if isinstance(find, Framed):
                meaning = fields_text(find.message)
            else:
                meaning = f"[damaged: {find.error}]" if isinstance(find, Damaged) else "[no telegram]"
            first, last = _holding(together, place), _holding(together, place + len(find.data) - 1)
            said = remarks + _of_request(together[first], together[last], broken)
            yield TracedLine(
                number=numbered[-1].number,
                time_s=together[first].ended,
                source=source,
                data=find.data,
                meaning=meaning,
                remarks=tuple(said),
            )
            # The bytes of a damaged telegram are decoded again from its second byte; show them once.
            place += len(find.data)

    def _finds(self, data: bytes, direction: Direction) -> list[Find]:
        """Return the telegrams and other bytes, decoded in the protocol that accounts for most bytes."""
        # Only one of several codecs that decode alike is tried.
        codecs = {codec_key(drive.codec): drive.codec for drive in self._drives}
        framers = [Framer(codec, direction) for codec in codecs.values()]
        readings = [_once([*framer.feed(data), *framer.flush()]) for framer in framers]
        return max(readings, key=_understood, default=[])

    def _remarks(self, together: Sequence[Transmission]) -> list[str]:
        said = []
        settings = _settings_of(together[0])
        if settings is not None and all(settings != drive.settings for drive in self._drives):
            said.append(f"sent with {settings}, which no drive here uses")
        if any(heard.garbled for heard in together):
            said.append("collided with others on the wire, or broke off")
        return said


def _of_request(first: Transmission, last: Transmission, broken: Sequence[Violation]) -> list[str]:
    """Return the violations by the master in the request that these transmissions carry."""
    if first.source != "master":
        return []
    begins = bisect_left(broken, first.began - _EXACT_S, key=_at_s)
    ends = bisect_right(broken, last.ended + _EXACT_S, key=_at_s)
    # Fully known wrong settings already have a remark at each transmission.
    return [str(each) for each in broken[begins:ends] if each.rule != "line settings" or first.agreed]


def _settings_of(sent: Transmission) -> LineSettings | None:
    # A drive sends with its own settings, which needs no remark; over plain TCP the master's are unknown.
    return sent.settings if sent.source == "master" and not sent.agreed else None


def _joined(heard: Iterable[_Numbered], gap_s: float) -> Iterator[list[_Numbered]]:
    """Yield groups of transmissions from one side without a pause between them."""
    together: list[_Numbered] = []
    for each in heard:
        if together and not _follows(each.sent, together[-1].sent, gap_s):
            yield together
            together = []
        together.append(each)
    if together:
        yield together


def _follows(sent: Transmission, last: Transmission, gap_s: float) -> bool:
    same = (sent.source, _settings_of(sent)) == (last.source, _settings_of(last))
    return same and sent.ended - last.ended <= gap_s


def _holding(together: Sequence[Transmission], place: int) -> int:
    """Return the number of the transmission that holds the byte at this position."""
    for number, heard in enumerate(together):
        if place < len(heard.data):
            return number
        place -= len(heard.data)
    return len(together) - 1


def _once(finds: list[Find]) -> list[Find]:
    """Return the finds without those inside the remains of a damaged telegram."""
    kept: list[Find] = []
    hidden = 0
    for find in finds:
        length = len(find.data)
        if isinstance(find, Damaged):
            if not hidden:
                kept.append(find)
                hidden = length
            continue
        inside = min(hidden, length)
        hidden -= inside
        if isinstance(find, Framed):
            kept.append(find)
        elif inside < length:
            kept.append(type(find)(find.data[inside:]))
    return kept


def _understood(finds: Sequence[Find]) -> tuple[int, int]:
    framed = sum(len(find.data) for find in finds if isinstance(find, Framed))
    return framed, sum(len(find.data) for find in finds if isinstance(find, Damaged))
