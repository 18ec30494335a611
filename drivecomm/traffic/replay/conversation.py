"""What was said in a capture as requests and what came back for them, by their bytes alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.capture import Capture
    from drivecomm.protocol import LineSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Bytes of a reply that came together.

    after_s: how long after the end of the request the last of them was there.
    """

    after_s: float
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchanged:
    """A request, and all that came before the next one.

    asked_s: when the last byte of the request was there. parts: of the reply, none where none came. settings: the line
    settings, where they are known.
    """

    asked_s: float
    request: bytes
    parts: tuple[Part, ...] = ()
    line: str = ""
    settings: LineSettings | None = None

    @property
    def reply(self) -> bytes:
        """The whole reply; empty where none came."""
        return b"".join(part.data for part in self.parts)

    @property
    def reply_s(self) -> float:
        """From the end of the request until the whole reply was there; 0 where none came."""
        return self.parts[-1].after_s if self.parts else 0.0


def exchanged(capture: Capture) -> list[Exchanged]:
    """Return the requests of a capture and their replies, in order; each line of it has its own conversation.

    Each piece of the master's is one request. What drives said before the first is left out, and so are pieces of which
    nobody knows who sent them. Raises UsageError when there are no others.
    """
    if capture.pieces and all(piece.source == "unknown" for piece in capture.pieces):
        raise UsageError("this capture does not say who sent what; tell requests and replies apart first")
    found: list[Exchanged] = []
    latest: dict[str, int] = {}
    for piece in capture.pieces:
        if piece.source == "master":
            latest[piece.line] = len(found)
            settings = piece.settings or capture.provenance.settings
            found.append(Exchanged(asked_s=piece.time_s, request=piece.data, line=piece.line, settings=settings))
        elif piece.source == "drive" and piece.line in latest:
            place = latest[piece.line]
            asked = found[place]
            part = Part(after_s=piece.time_s - asked.asked_s, data=piece.data)
            found[place] = replace(asked, parts=(*asked.parts, part))
    return found
