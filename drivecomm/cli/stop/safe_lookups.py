"""Look-ups that only assist a stop, such as the search for a server; none of their errors prevents the stop."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

from drivecomm.cli.output import complain

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


class SafeLookups:
    """Runner of assisting look-ups, which notes each of their errors once."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._noted: set[str] = set()
        self.lost: set[int] = set()
        """Process numbers of programs that did not respond once, and are skipped."""

    def of(self, look_up: Callable[[], T], otherwise: T, what: str) -> T:
        """Return the result of a look-up; on any error, note it and return `otherwise`.

        what: sentence about the error, without its reason.
        """
        try:
            return look_up()
        except Exception as error:  # noqa: BLE001 - a failed look-up must not prevent a stop
            self.note(f"{what}: {error or type(error).__name__}")
            return otherwise

    def note(self, text: str | Exception) -> None:
        """Print a note once; a failure of the output is ignored."""
        if str(text) not in self._noted:
            self._noted.add(str(text))
            with suppress(Exception):
                complain(text, as_json=self._as_json)
