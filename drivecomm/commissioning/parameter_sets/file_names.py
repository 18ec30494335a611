"""File names for drives: whatever a plant calls them, on every file system."""

from __future__ import annotations

from string import ascii_lowercase, ascii_uppercase, digits

_PLAIN = frozenset(ascii_lowercase + ascii_uppercase + digits + "-_")
_DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{each}" for port in ("com", "lpt") for each in digits)})
"""What Windows takes for a device, whatever is behind the point."""


def file_stem(drive: str) -> str:
    """Return the name of a drive's file, without its ending; different drives have different ones on every system.

    What not every file system has in a name is written as %xx, and which letters are large as a number behind ~, since
    some take large and small letters for the same: pump, P101~1, vabus%3a1.
    """
    name = "".join(
        sign if sign in _PLAIN else "".join(f"%{byte:02x}" for byte in sign.encode("utf-8")) for sign in drive
    )
    large = sum(1 << place for place, sign in enumerate(drive) if sign in ascii_uppercase)
    return f"{name}~{large:x}" if large or drive in _DEVICES else name
