"""Pieces of bytes received from a line, and the properties of that line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from drivecomm.protocol import LineSettings

Source: TypeAlias = Literal["master", "drive", "unknown"]
"""Sender of a piece, as far as known when it was captured."""


LONGEST_S = 3_000_000_000
"""Maximum duration of a capture in seconds; still fits 64 bits of nanoseconds since 1970."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Bytes that arrived together.

    time_s: time of the last byte, in seconds since the start of the capture. source: sender. line: name of the line in
    a capture of several lines. settings: line settings of the piece if they differ from those of the capture.
    """

    time_s: float
    data: bytes
    source: Source = "unknown"
    line: str = ""
    settings: LineSettings | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Origin of a capture.

    began: start of the capture, with time zone. tool: program that captured, with its version. port: name of the port.
    settings: line settings; None if unknown. drives: known drives on the line, as PROTOCOL:ADDRESS. note: remark for
    the reader.
    """

    began: datetime | None = None
    tool: str = ""
    port: str = ""
    settings: LineSettings | None = None
    drives: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """Whole capture: its origin, and its pieces sorted by time.

    remarks: sentences about skipped content, such as an incomplete last line.
    """

    provenance: Provenance
    pieces: Sequence[Piece]
    remarks: tuple[str, ...] = ()
