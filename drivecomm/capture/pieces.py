"""Pieces of bytes as they came over a line, and what is known of the line that they came over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from drivecomm.protocol import LineSettings

Source: TypeAlias = Literal["master", "drive", "unknown"]
"""Who sent a piece, as far as it could be known when it was captured."""


LONGEST_S = 3_000_000_000
"""Longer than any line is listened to, and short enough for times since 1970 in 64 bits of nanoseconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Bytes that came together.

    time_s: when the last of them was there, in seconds since the capture began. source: who sent them. line: the name
    of the line, where a capture has several. settings: the line settings that they were heard or sent with, where they
    differ from those of the capture or change.
    """

    time_s: float
    data: bytes
    source: Source = "unknown"
    line: str = ""
    settings: LineSettings | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a capture comes from.

    began: the time of day at which it began, with its time zone. tool: the program that captured, with its version.
    port: what it listened at. settings: the line settings; None where they are not known. drives: the drives that are
    known to be on the line, as PROTOCOL:ADDRESS. note: what a reader should know.
    """

    began: datetime | None = None
    tool: str = ""
    port: str = ""
    settings: LineSettings | None = None
    drives: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """A whole capture: where it comes from, and its pieces in the order of their times.

    remarks: what its reader had to leave out, in sentences, such as a last line that is cut off.
    """

    provenance: Provenance
    pieces: Sequence[Piece]
    remarks: tuple[str, ...] = ()
