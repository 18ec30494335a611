"""One table of a vector file, read strictly; errors name the file, the line and the id."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.tomlfile import Kind, TomlTable


class VectorEntry:
    """A table of a vector file that accepts only known keys. All methods raise FileFormatError.

    given: the content of the table. error: creates the error for the whole table, or for one of its keys.
    """

    def __init__(self, table: TomlTable, known: Mapping[str, Kind], *needed: str) -> None:
        self.error = table.error
        self.given = table.take(known, *needed)
        for key in needed:
            if isinstance(self.given[key], str):
                self.filled(key)

    def only(self, owner: str, *keys: str, allowed: bool) -> None:
        """Refuse keys that do not belong in an entry of this kind."""
        for key in keys:
            if key in self.given and not allowed:
                raise self.error(f"{owner} has no {key}", key)

    def filled(self, key: str) -> str:
        """Return a text; it must not be empty."""
        text: str = self.given[key]
        if not text.strip():
            raise self.error(f"{key} is empty", key)
        return text

    def choice(self, key: str, allowed: Sequence[str]) -> Any:
        """Return a text that must be one of the allowed words."""
        word = self.filled(key)
        if word not in allowed:
            raise self.error(f"{key} {word!r} is not one of {', '.join(allowed)}", key)
        return word

    def seconds(self, key: str) -> float | None:
        """Return a time in seconds that is not negative, or None if it is absent."""
        value = self.given.get(key)
        if value is not None and not 0 <= value < 1e9:
            raise self.error(f"invalid {key} = {value!r}; write seconds from 0 to 1e9", key)
        return None if value is None else float(value)

    def data(self, key: str) -> bytes:
        """Remove a text of hexadecimal digits in any spacing, and return its bytes; at least one is required."""
        return self._data(key, self.given.pop(key))

    def data_list(self, key: str) -> tuple[bytes, ...]:
        """Remove a list of hexadecimal texts, which may be empty, and return the bytes of each."""
        values = self.given.pop(key)
        if not all(isinstance(value, str) for value in values):
            raise self.error(f"{key} is not a list of texts", key)
        return tuple(self._data(key, value) for value in values)

    def _data(self, key: str, digits: str) -> bytes:
        try:
            data = bytes.fromhex(digits)
        except ValueError as error:
            raise self.error(f"{key} is not hexadecimal: {error}", key) from None
        if not data:
            raise self.error(f"{key} is empty", key)
        return data
