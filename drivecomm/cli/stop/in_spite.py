"""Look-ups that only help a stop, such as whether there is a server: whatever they raise, the stop goes out."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

from drivecomm.cli.output import complain

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


class InSpite:
    """Carries helping look-ups out, and notes once each what was wrong with them."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._noted: set[str] = set()
        self.lost: set[int] = set()
        """Programs that did not answer once, and are asked no more."""

    def of(self, look_up: Callable[[], T], otherwise: T, what: str) -> T:
        """Return the result of a look-up; if it raises anything, note that, and return what is given otherwise.

        what: the sentence about it, without its reason.
        """
        try:
            return look_up()
        except Exception as error:  # noqa: BLE001 - nothing that only helps keeps a motor running
            self.note(f"{what}: {error or type(error).__name__}")
            return otherwise

    def note(self, text: str | Exception) -> None:
        """Say what was wrong, once; that it cannot be said is no reason to go no further."""
        if str(text) not in self._noted:
            self._noted.add(str(text))
            with suppress(Exception):
                complain(text, as_json=self._as_json)
