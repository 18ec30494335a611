"""Comparing what a virtual drive holds with a raw number: each protocol shows what is held in its own way."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import VirtualDrive


class HeldForms:
    """What a raw number looks like in a drive.

    A VABus drive holds eight hexadecimal characters, and the raw number is 1000: so another drive of the same sort is
    set to 1000 and shows what it then holds. another: makes such a drive.
    """

    def __init__(self, another: Callable[[], VirtualDrive]) -> None:
        self._make = another
        self._known: dict[tuple[str, int | str], int | str] = {}

    def of(self, parameter: str, raw: int | str) -> int | str:
        """Return what a drive shows that holds this; the raw value itself where that cannot be tried out.

        It cannot where the drive refuses the value, and where it does not heed it: what it measures cannot be set.
        """
        if (parameter, raw) not in self._known:
            self._known[parameter, raw] = self._tried(parameter, raw)
        return self._known[parameter, raw]

    @cached_property
    def _another(self) -> VirtualDrive:
        return self._make()

    def _tried(self, parameter: str, raw: int | str) -> int | str:
        before = self._another.peek(parameter, 0.0)
        shown = self._after(parameter, raw)
        if shown is None:
            return raw
        if shown != before:
            return shown
        # It held this before, or it does not heed what it is set to.
        others = (self._after(parameter, raw + step) for step in (1, -1)) if isinstance(raw, int) else ()
        return shown if any(other not in (None, shown) for other in others) else raw

    def _after(self, parameter: str, raw: int | str) -> int | str | None:
        """Return what the other drive shows after it was set to this, None when it does not take it."""
        try:
            self._another.poke(parameter, raw)
            return self._another.peek(parameter, 0.0)
        except (DriveCommError, ValueError):
            return None
