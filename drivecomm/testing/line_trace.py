"""What went over one virtual line, decoded when somebody wants to read it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from drivecomm.link import ARROWS, fields_text, hex_text, line_text
from drivecomm.protocol import Damaged, Framed, Framer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.capture import Piece
    from drivecomm.protocol import Codec, Direction, Find, VirtualDrive

_MOST_PIECES = 5000
_MOST_LINES = 80


@dataclass(frozen=True, slots=True)
class TracedPiece:
    """A piece, and whether it met others on the wire or broke off."""

    piece: Piece
    disturbed: bool


class LineTrace:
    """The last 5000 pieces on one line. Nothing is decoded until the trace is read."""

    def __init__(self, drives: Sequence[VirtualDrive]) -> None:
        self._drives = drives
        self._heard: deque[TracedPiece] = deque(maxlen=_MOST_PIECES)
        self._guard = Lock()

    def add(self, piece: Piece, *, disturbed: bool = False) -> None:
        """Note down what was on the line."""
        with self._guard:
            self._heard.append(TracedPiece(piece, disturbed))

    def lines(self) -> Iterator[str]:
        """Yield one line of text for each telegram, and for what is none: time, direction, bytes, meaning."""
        with self._guard:
            heard = list(self._heard)
        gap_s = max((drive.gap_s for drive in self._drives), default=0.0)
        for together in _joined(heard, gap_s):
            yield from self._told(together)

    def text(self) -> str:
        """Return the last 80 lines."""
        lines = list(self.lines())
        if not lines:
            return "nothing was on the line"
        left_out = len(lines) - _MOST_LINES
        head = [f"({left_out} earlier ones are left out)"] if left_out > 0 else []
        return "\n".join([*head, *lines[-_MOST_LINES:]])

    def _told(self, together: Sequence[TracedPiece]) -> Iterator[str]:
        source, place = together[0].piece.source, 0
        data = b"".join(heard.piece.data for heard in together)
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
        # Drives of one protocol need not be asked one by one.
        codecs = {type(drive.codec): drive.codec for drive in self._drives}
        readings = [_once(_read(codec, direction, data)) for codec in codecs.values()]
        return max(readings, key=_understood, default=[])

    def _remarks(self, together: Sequence[TracedPiece]) -> list[str]:
        said = []
        settings = together[0].piece.settings
        if settings is not None and all(settings != drive.settings for drive in self._drives):
            said.append(f"sent with {settings}, which no drive here listens with")
        if any(heard.disturbed for heard in together):
            said.append("met others on the wire, or broke off")
        return said


def _joined(heard: Iterable[TracedPiece], gap_s: float) -> Iterator[list[TracedPiece]]:
    """Yield pieces that came from one side without a pause between them."""
    together: list[TracedPiece] = []
    for each in heard:
        if together and not _follows(each.piece, together[-1].piece, gap_s):
            yield together
            together = []
        together.append(each)
    if together:
        yield together


def _follows(piece: Piece, last: Piece, gap_s: float) -> bool:
    same = (piece.source, piece.settings) == (last.source, last.settings)
    return same and piece.time_s - last.time_s <= gap_s


def _time_of(together: Sequence[TracedPiece], place: int) -> float:
    """Return when the piece came that the byte at this place is in."""
    for heard in together:
        if place < len(heard.piece.data):
            return heard.piece.time_s
        place -= len(heard.piece.data)
    return together[-1].piece.time_s


def _read(codec: Codec, direction: Direction, data: bytes) -> list[Find]:
    framer = Framer(codec, direction)
    return [*framer.feed(data), *framer.flush()]


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
