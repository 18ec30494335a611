"""Captures as JSON Lines: a header line with the origin of the capture, then one line per piece.

    {"format": "drivecomm-capture", "version": 1, "began": "2026-05-04T09:00:00+00:00", "port": "/dev/ttyUSB0"}
    {"time_s": 0.009167, "source": "master", "hex": "04 41 30 30 34 38 31 05"}
    {"time_s": 0.041203, "source": "drive", "hex": "41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48"}

A piece may also have "line", the name of its line in a capture of several lines, and "settings", as in the header.
"""

from __future__ import annotations

import json
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.capture.pieces import LONGEST_S, Piece, Provenance, Source
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import SETTING_NAMES, LineSettings

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO


_SOURCES: tuple[Source, ...] = get_args(Source)
_KEYS = frozenset(("time_s", "source", "hex", "line", "settings"))
_decode = json.JSONDecoder().raw_decode
_LONGEST_LINE = 16 * 1024 * 1024


class JsonLines:
    """Encoder of a capture as JSON Lines."""

    def __init__(self, provenance: Provenance) -> None:
        self._provenance = provenance

    def opening(self) -> bytes:
        """Return the header line."""
        return _line(header_of(self._provenance))

    def piece(self, piece: Piece) -> bytes:
        """Return the line of a piece."""
        content: dict[str, Any] = {
            # Nanoseconds, the resolution of pcapng.
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
        """Undo the last piece, which did not reach the file. No later piece depends on it."""


class JsonLinesReader:
    """Reader of a JSON Lines capture. remarks: sentences about skipped content, complete after the last piece.

    Raises FileFormatError with the file and the invalid line.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self.remarks: list[str] = []
        try:
            self.provenance = _provenance(_object(file.readline(_LONGEST_LINE).removesuffix(b"\n")))
        except FileFormatError as error:
            raise FileFormatError(f"{path}: line 1: {error}") from error

    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces in the order of the file; callable once only."""
        lines = iter(partial(self._file.readline, _LONGEST_LINE), b"")
        for number, line in enumerate(lines, start=2):
            try:
                yield _piece(_object(line.removesuffix(b"\n")))
            except FileFormatError as error:
                if line.endswith(b"\n") or len(line) == _LONGEST_LINE:
                    raise FileFormatError(f"{self._path}: line {number}: {error}") from error
                # Only a line that was being written when its program ended lacks a line end.
                self.remarks.append(f"{self._path}: line {number} is cut off and left out")


def _line(content: dict[str, Any]) -> bytes:
    return json.dumps(content, ensure_ascii=False).encode() + b"\n"


def _loaded(line: bytes) -> Any:
    if line.startswith(b"{") and line.endswith(b"}") and line.isascii():
        text = line.decode("ascii")
        content, end = _decode(text)
        if end == len(text):
            return content
    return json.loads(line)


def _object(line: bytes) -> dict[str, Any]:
    try:
        content = _loaded(line)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"not valid JSON ({error})") from error
    if not isinstance(content, dict):
        raise FileFormatError("not a JSON object")
    return content


def _provenance(content: dict[str, Any]) -> Provenance:
    if not is_header(content):
        raise FileFormatError('"format": "drivecomm-capture" is missing')
    return provenance_of(content)


def _piece(content: dict[str, Any]) -> Piece:
    check_keys(content, _KEYS)
    time_s, source = content.get("time_s"), content.get("source", "unknown")
    if isinstance(time_s, bool) or not isinstance(time_s, int | float) or not 0 <= time_s <= LONGEST_S:
        raise FileFormatError(f"time_s {time_s!r} is not a number of seconds from 0 to 3e9")
    if source not in _SOURCES:
        raise FileFormatError(f"source {source!r} is not one of {', '.join(_SOURCES)}")
    try:
        data = bytes.fromhex(text(content, "hex"))
    except ValueError as error:
        raise FileFormatError(f"invalid hex: {error}") from error
    if not data:
        raise FileFormatError("hex is missing or empty")
    return Piece(
        time_s=float(time_s), data=data, source=source, line=text(content, "line"), settings=settings_in(content)
    )


FORMAT = "drivecomm-capture"
VERSION = 1

_TEXTS = ("tool", "port", "note")


def header_of(provenance: Provenance) -> dict[str, Any]:
    """Return the header object for a provenance. Raises UsageError for a time without a time zone."""
    header: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    if provenance.began is not None:
        if provenance.began.tzinfo is None:
            raise UsageError("the time at which a capture began needs a time zone, such as datetime.now(UTC)")
        header["began"] = provenance.began.isoformat()
    header |= {name: getattr(provenance, name) for name in _TEXTS if getattr(provenance, name)}
    if provenance.settings is not None:
        header["settings"] = settings_object(provenance.settings)
    if provenance.drives:
        header["drives"] = list(provenance.drives)
    return header


def is_header(content: object) -> bool:
    """Return whether this is a header object of any version."""
    return isinstance(content, dict) and content.get("format") == FORMAT


def provenance_of(header: Mapping[str, Any]) -> Provenance:
    """Return the provenance in a header object. Raises FileFormatError for an invalid key or value."""
    if header.get("version") != VERSION:
        raise FileFormatError(f"version {header.get('version')!r} of the format is not supported, only {VERSION} is")
    check_keys(header, ("format", "version", "began", "settings", "drives", *_TEXTS))
    drives = header.get("drives", [])
    if not isinstance(drives, list) or not all(isinstance(drive, str) for drive in drives):
        raise FileFormatError("drives is not a list of texts such as vabus:1")
    texts = {name: text(header, name) for name in _TEXTS}
    return Provenance(
        began=_time_of_day(text(header, "began")) if "began" in header else None,
        settings=settings_in(header),
        drives=tuple(drives),
        **texts,
    )


def settings_object(settings: LineSettings) -> dict[str, Any]:
    """Return line settings as an object."""
    return {name: getattr(settings, name) for name in SETTING_NAMES}


def settings_in(content: Mapping[str, Any]) -> LineSettings | None:
    """Return the line settings in an object, None if there are none. Raises FileFormatError."""
    given = content.get("settings")
    if given is None:
        return None
    if not isinstance(given, dict):
        raise FileFormatError("settings is not an object")
    check_keys(given, SETTING_NAMES)
    try:
        return LineSettings(**given)
    except UsageError as error:
        raise FileFormatError(f"settings: {error}") from error


def text(content: Mapping[str, Any], key: str) -> str:
    """Return the text under a key, "" if the key is missing. Raises FileFormatError for another type."""
    value = content.get(key, "")
    if not isinstance(value, str):
        raise FileFormatError(f"{key} is not a text")
    if not value.isascii() and any("\ud800" <= character <= "\udfff" for character in value):
        raise FileFormatError(f"{key} contains an unpaired surrogate")
    return value


def check_keys(content: Mapping[str, Any], known: Iterable[str]) -> None:
    """Raise FileFormatError for an unknown key, so that a misspelt key is not taken for a missing one."""
    if unknown := content.keys() - known:
        raise FileFormatError(f"unknown key {min(unknown)!r}")


def _time_of_day(written: str) -> datetime:
    try:
        began = datetime.fromisoformat(written)
    except ValueError as error:
        raise FileFormatError(f"began: {error}") from error
    if began.tzinfo is None:
        raise FileFormatError(f"began {written!r} has no time zone")
    return began
