"""Whether a write is kept without mains, and what a caller must have said for that: the rule of all protocols."""

from __future__ import annotations

from typing import Literal, TypeAlias

from drivecomm.errors import NotSupported

Kept: TypeAlias = Literal["always", "never", "as asked", "unknown"]
"""What becomes of a write when mains goes. always: each one may go to EEPROM, whose cells wear out. never: it is gone.
as asked: the drive knows both. unknown: no manual says it."""


def check_store(what: str, kept: Kept, *, store: bool) -> None:
    """Raise NotSupported for a write that is kept without being asked for, and for one that cannot be kept for sure.

    what: the parameter, as its messages name it. store: whether the caller has asked for it.
    """
    if store and kept == "never":
        raise NotSupported(f"{what} is not kept without mains; write it without store=True", says="store=True")
    if store and kept == "unknown":
        raise NotSupported(
            f"whether {what} is kept without mains is not known; write it without store=True", says="store=True"
        )
    if not store and kept == "always":
        raise NotSupported(
            f"a write to {what} may go to the EEPROM of the drive, which wears out; write it with store=True",
            says="store=True",
        )
