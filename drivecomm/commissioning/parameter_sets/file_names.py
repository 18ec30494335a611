"""File names for drives: valid on every file system, for any drive name in a plant."""

from __future__ import annotations

from string import ascii_lowercase, ascii_uppercase, digits

_PLAIN = frozenset(ascii_lowercase + ascii_uppercase + digits + "-_")
_DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{each}" for port in ("com", "lpt") for each in digits)})
"""Names that Windows reserves for devices, with any file ending."""


def file_stem(drive: str) -> str:
    """Return the name of a drive's file without its ending; different drives get different names on every system.

    Characters that some file systems do not allow are written as %xx. Capital letters are coded as a number after ~,
    since some file systems ignore case: pump, P101~1, vabus%3a1.
    """
    name = "".join(
        sign if sign in _PLAIN else "".join(f"%{byte:02x}" for byte in sign.encode("utf-8")) for sign in drive
    )
    large = sum(1 << place for place, sign in enumerate(drive) if sign in ascii_uppercase)
    return f"{name}~{large:x}" if large or drive in _DEVICES else name
