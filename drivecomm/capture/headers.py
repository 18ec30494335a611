"""Where a capture comes from, as a JSON object: the first line of a JSON Lines file, a comment in a pcapng file."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

from drivecomm.capture.pieces import Provenance
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import LineSettings

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

FORMAT = "drivecomm-capture"
VERSION = 1

_TEXTS = ("tool", "port", "note")
_SETTINGS = ("baudrate", "bytesize", "parity", "stopbits")


def header_of(provenance: Provenance) -> dict[str, Any]:
    """Return the object that says where a capture comes from. Raises UsageError for a time without its time zone."""
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
    """Return whether this is such an object, of whatever version."""
    return isinstance(content, dict) and content.get("format") == FORMAT


def provenance_of(header: Mapping[str, Any]) -> Provenance:
    """Return what such an object says. Raises FileFormatError for a key or a value that cannot be."""
    if header.get("version") != VERSION:
        raise FileFormatError(f"version {header.get('version')!r} of the format is not known, only {VERSION} is")
    only(header, ("format", "version", "began", "settings", "drives", *_TEXTS))
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
    return {name: getattr(settings, name) for name in _SETTINGS}


def settings_in(content: Mapping[str, Any]) -> LineSettings | None:
    """Return the line settings that an object gives, None if it gives none. Raises FileFormatError."""
    given = content.get("settings")
    if given is None:
        return None
    if not isinstance(given, dict):
        raise FileFormatError("settings is not an object")
    only(given, _SETTINGS)
    try:
        return LineSettings(**given)
    except UsageError as error:
        raise FileFormatError(f"settings: {error}") from error


def text(content: Mapping[str, Any], key: str) -> str:
    """Return a text, an empty one where there is none. Raises FileFormatError for anything else."""
    value = content.get(key, "")
    if not isinstance(value, str):
        raise FileFormatError(f"{key} is not a text")
    if any("\ud800" <= character <= "\udfff" for character in value):
        raise FileFormatError(f"{key} has half a character in it")
    return value


def only(content: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse keys that nobody knows, so that a misspelt one is not read as absent. Raises FileFormatError."""
    if unknown := sorted(set(content) - set(known)):
        raise FileFormatError(f"the key {unknown[0]!r} is not known")


def _time_of_day(written: str) -> datetime:
    try:
        began = datetime.fromisoformat(written)
    except ValueError as error:
        raise FileFormatError(f"began: {error}") from error
    if began.tzinfo is None:
        raise FileFormatError(f"began {written!r} has no time zone")
    return began
