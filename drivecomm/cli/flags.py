"""What the keywords of Python in a sentence are called on the command line."""

from __future__ import annotations

from drivecomm.errors import DriveCommError

_FLAGS = {
    "store": "--store",
    "reply_timeout_s": "--timeout",
    "attempts": "--attempts",
    "rs485": "--rs485",
    "low_latency": "--low-latency",
}
"""Keywords that are flags; all others are options of a drive, and are written behind its name."""


def in_flags(text: str, error: Exception | str) -> str:
    """Return what an error says with the command line's words for its keywords."""
    for keyword in _said_by(error):
        text = text.replace(keyword, _written(keyword, _drive_of(error)))
    return text


def _said_by(error: object) -> tuple[str, ...]:
    """Return the keywords in an error's sentence; one that tells of another one has its words, too."""
    if not isinstance(error, DriveCommError):
        return ()
    return tuple(dict.fromkeys((*error.says, *_said_by(error.__cause__))))


def _drive_of(error: object) -> str:
    about = error.about if isinstance(error, DriveCommError) else None
    return about["name"] if about else "DRIVE"


def _written(keyword: str, drive: str) -> str:
    name, equals, value = keyword.partition("=")
    if name not in _FLAGS:
        return f"{drive},{keyword}" if equals else f"{drive},{name}=..."
    return _FLAGS[name] if value in ("", "True") else f"{_FLAGS[name]} {value}"
