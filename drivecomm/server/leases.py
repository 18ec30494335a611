"""Who may command a drive now: one commander each, for a short time, renewed, and seen by everybody."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.server.door import Caller


@dataclass(frozen=True, slots=True, kw_only=True)
class Lease:
    """The right to command one drive. until_s: in seconds since 1970. key: known to its holder alone."""

    drive: str
    holder: Caller
    until_s: float
    key: str
