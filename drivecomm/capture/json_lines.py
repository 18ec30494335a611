r"""Captures as JSON Lines: a line that says where the capture comes from, then one line for each piece.

    {"format": "drivecomm-capture", "version": 1, "began": "2026-05-04T09:00:00+00:00", "port": "/dev/ttyUSB0"}
    {"time_s": 0.009167, "source": "master", "hex": "04 41 30 30 34 38 31 05"}
    {"time_s": 0.041203, "source": "drive", "hex": "41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48"}

A piece may also have "line", its name where a capture has several lines, and "settings", as in the first line.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.capture.headers import header_of, is_header, only, provenance_of, settings_in, settings_object, text
from drivecomm.capture.pieces import LONGEST_S, Capture, Piece, Source
from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.capture.pieces import Provenance

_SOURCES: tuple[Source, ...] = get_args(Source)
_KEYS = ("time_s", "source", "hex", "line", "settings")


class JsonLines:
    """A capture as it is written, line by line."""

    def __init__(self, provenance: Provenance) -> None:
        self._provenance = provenance

    def opening(self) -> bytes:
        """Return what the file begins with."""
        return _line(header_of(self._provenance))

    def piece(self, piece: Piece) -> bytes:
        """Return what a piece adds to it."""
        content: dict[str, Any] = {
            # Nanoseconds are more than anybody measures, and what pcapng keeps.
            "time_s": round(piece.time_s, 9),
            "source": piece.source,
            "hex": piece.data.hex(" ").upper(),
        }
        if piece.line:
            content["line"] = piece.line
        if piece.settings is not None:
            content["settings"] = settings_object(piece.settings)
        return _line(content)

    def take_back(self) -> None:
        """Take it that the latest piece did not get into the file; no other depends on it."""


def read_json_lines(path: Path, content: bytes) -> Capture:
    """Return the capture that these lines hold. Raises FileFormatError with the file and the line that is wrong."""
    lines = content.split(b"\n")
    last = lines.pop()
    try:
        provenance = _provenance(_object(lines[0] if lines else last))
    except FileFormatError as error:
        raise FileFormatError(f"{path}: line 1: {error}") from error
    pieces = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            pieces.append(_piece(_object(line)))
        except FileFormatError as error:
            raise FileFormatError(f"{path}: line {number}: {error}") from error
    remarks: tuple[str, ...] = ()
    if lines and last:
        # Only a line that was being written when its program ended has no end.
        try:
            pieces.append(_piece(_object(last)))
        except FileFormatError:
            remarks = (f"{path}: line {len(lines) + 1} is cut off and left out",)
    return Capture(provenance=provenance, pieces=sorted(pieces, key=_time), remarks=remarks)


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content, ensure_ascii=False).encode() + b"\n"


def _object(line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"it is no JSON ({error})") from error
    if not isinstance(content, dict):
        raise FileFormatError("it is no JSON object")
    return content


def _provenance(content: dict[str, Any]) -> Provenance:
    if not is_header(content):
        raise FileFormatError('it does not say "format": "drivecomm-capture"')
    return provenance_of(content)


def _piece(content: dict[str, Any]) -> Piece:
    only(content, _KEYS)
    time_s, source = content.get("time_s"), content.get("source", "unknown")
    if isinstance(time_s, bool) or not isinstance(time_s, int | float) or not 0 <= time_s <= LONGEST_S:
        raise FileFormatError(f"time_s {time_s!r} is no number of seconds from 0 to 3e9")
    if source not in _SOURCES:
        raise FileFormatError(f"source {source!r} is not one of {', '.join(_SOURCES)}")
    try:
        data = bytes.fromhex(text(content, "hex"))
    except ValueError as error:
        raise FileFormatError(f"hex is no hexadecimal: {error}") from error
    if not data:
        raise FileFormatError("hex is missing or empty")
    return Piece(
        time_s=float(time_s), data=data, source=source, line=text(content, "line"), settings=settings_in(content)
    )


def _time(piece: Piece) -> float:
    return piece.time_s
