"""What a restore is to do, beyond what it does by itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What somebody who restores has said.

    only: addresses, names or common names of the parameters to restore; empty for all. communication: also write
    addresses, baud rates and the like, which can cut the line. another_drive: the set may be of another drive, of
    another model or another maker. volatile: keep nothing over power-off, where the drive makes the difference.
    """

    only: frozenset[str] = frozenset()
    communication: bool = False
    another_drive: bool = False
    volatile: bool = False
