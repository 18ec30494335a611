"""The rule of all protocols for stored writes: a caller must request them explicitly."""

from __future__ import annotations

from typing import Literal, TypeAlias

from drivecomm.errors import NotSupported

Kept: TypeAlias = Literal["always", "never", "as asked", "unknown"]
"""Fate of a written value when the mains is switched off.

always: it is kept, since each write may go to EEPROM, whose cells wear out. never: it is lost. as asked: the drive
supports both. unknown: no manual says it.
"""


def check_store(what: str, kept: Kept, *, store: bool) -> None:
    """Raise NotSupported for a stored write without a request, and for a requested one that may not be stored.

    what: the parameter, as the messages name it. store: whether the caller has requested a stored write.
    """
    if store and kept == "never":
        raise NotSupported(f"{what} is not kept without mains; write it without store=True", says="store=True")
    if store and kept == "unknown":
        raise NotSupported(
            f"whether {what} is kept without mains is unknown; write it without store=True", says="store=True"
        )
    if not store and kept == "always":
        raise NotSupported(
            f"a write to {what} may go to the EEPROM of the drive, which wears out; write it with store=True",
            says="store=True",
        )
