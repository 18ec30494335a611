"""What went over one virtual line, decoded when somebody wants to read it."""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import TYPE_CHECKING

from drivecomm.link import ARROWS, fields_text, hex_text, line_text
from drivecomm.protocol import Damaged, Framed, Framer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.protocol import Direction, Find, LineSettings
    from drivecomm.virtual import Transmission, VirtualLine

_MOST_HEARD = 5000
_MOST_LINES = 80


class LineTrace:
    """The last 5000 transmissions on one line, from now on. Nothing is decoded until the trace is read."""

    def __init__(self, line: VirtualLine) -> None:
        self._drives = line.drives
        self._heard: deque[Transmission] = deque(maxlen=_MOST_HEARD)
        self._guard = Lock()
        line.monitors.append(self._add)

    def _add(self, sent: Transmission) -> None:
        with self._guard:
            self._heard.append(sent)

    def text(self) -> str:
        """Return a line for each telegram, and for what is none: time, direction, bytes, meaning; the last 80 lines."""
        with self._guard:
            heard = list(self._heard)
        gap_s = max((drive.gap_s for drive in self._drives), default=0.0)
        lines = [line for together in _joined(heard, gap_s) for line in self._told(together)]
        if not lines:
            return "nothing was on the line"
        left_out = len(lines) - _MOST_LINES
        head = [f"({left_out} earlier ones are left out)"] if left_out > 0 else []
        return "\n".join([*head, *lines[-_MOST_LINES:]])

    def _told(self, together: Sequence[Transmission]) -> Iterator[str]:
        source, place = together[0].source, 0
        data = b"".join(heard.data for heard in together)
        remarks = self._remarks(together)
        for find in self._finds(data, "reply" if source == "drive" else "request"):
            if isinstance(find, Framed):
                meaning = fields_text(find.message)
            else:
                meaning = f"[damaged: {find.error}]" if isinstance(find, Damaged) else "[no telegram]"
            time_s, arrow = _time_of(together, place), ARROWS.get(source, "??")
            yield line_text(time_s, arrow, hex_text(find.data), meaning, remarks=remarks)
            # The bytes of a damaged telegram are looked at again; here they are shown once.
            place += len(find.data)

    def _finds(self, data: bytes, direction: Direction) -> list[Find]:
        """Return what the protocol that understands most of it makes of these bytes."""
        # Drives that read alike need not be asked one by one.
        codecs = {getattr(drive.codec, "alike", type(drive.codec)): drive.codec for drive in self._drives}
        framers = [Framer(codec, direction) for codec in codecs.values()]
        readings = [_once([*framer.feed(data), *framer.flush()]) for framer in framers]
        return max(readings, key=_understood, default=[])

    def _remarks(self, together: Sequence[Transmission]) -> list[str]:
        said = []
        settings = _settings_of(together[0])
        if settings is not None and all(settings != drive.settings for drive in self._drives):
            said.append(f"sent with {settings}, which no drive here listens with")
        if any(heard.garbled for heard in together):
            said.append("met others on the wire, or broke off")
        return said


def _settings_of(sent: Transmission) -> LineSettings | None:
    # What a drive sends has the settings of that drive, which are no news; over plain TCP they are not known.
    return sent.settings if sent.source == "master" and not sent.agreed else None


def _joined(heard: Iterable[Transmission], gap_s: float) -> Iterator[list[Transmission]]:
    """Yield what came from one side without a pause in it."""
    together: list[Transmission] = []
    for each in heard:
        if together and not _follows(each, together[-1], gap_s):
            yield together
            together = []
        together.append(each)
    if together:
        yield together


def _follows(sent: Transmission, last: Transmission, gap_s: float) -> bool:
    same = (sent.source, _settings_of(sent)) == (last.source, _settings_of(last))
    return same and sent.ended - last.ended <= gap_s


def _time_of(together: Sequence[Transmission], place: int) -> float:
    """Return when the byte at this place came."""
    for heard in together:
        if place < len(heard.data):
            return heard.ended
        place -= len(heard.data)
    return together[-1].ended


def _once(finds: list[Find]) -> list[Find]:
    """Leave out what is found in the remains of a damaged telegram."""
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
