"""An input read as a sequence of choices, so that a mutation of its bytes changes the choices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

T = TypeVar("T")

_STRANGE: tuple[Any, ...] = (
    *(None, True, False, "", "0", "-1", "1.5", "nan", "Infinity", "1e999999999", "²", "\ud800", "\x00", " ", "x" * 600),
    *(0, -1, 1, 9, 10, 255, 256, 32767, 32768, 65535, 65536, -32768, -32769, 2**31, 2**32, 10**30, -(10**400)),
    *(0.5, float("nan"), float("inf"), (), [], [0], {}, b"\x00", 1j),
)


class Choices:
    """Reader of choices from an input; after the end of the input, every choice is the first one."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def below(self, limit: int) -> int:
        """Return a number from 0 to limit - 1, from two bytes if one is not enough."""
        size = 1 if limit <= 256 else 2
        taken = self._data[self._place : self._place + size]
        self._place += size
        return int.from_bytes(taken) % limit

    def one_of(self, things: Sequence[T]) -> T:
        """Return one of these things."""
        return things[self.below(len(things))]

    def value(self) -> Any:
        """Return a value for a field: a number of any size, a text, or an invalid value."""
        way = self.below(3)
        if way == 0:
            return self.one_of(_STRANGE)
        taken = self._data[self._place : self._place + 1 + self.below(5)]
        return int.from_bytes(taken, signed=True) if way == 1 else taken.decode("latin-1")
