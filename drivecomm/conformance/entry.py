"""One table of a vector file, read key by key; whatever is wrong is named with file and id."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Entry:
    """A `[[vector]]`, `[[stream]]` or `[[refuse]]`; remembers which of its keys were asked for.

    shown: the file as messages name it. number: its place among its kind, for those whose id is what is wrong.
    """

    def __init__(self, shown: str, kind: str, number: int, content: Mapping[str, Any]) -> None:
        self.kind = kind
        self._shown = shown
        self._number = number
        self._content = content
        self._known: set[str] = {"id"}
        self.id = ""
        self.id = self.text("id")

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def wrong(self, what: str) -> FileFormatError:
        """Return the error that says what is wrong with this entry."""
        name = self.id or f"number {self._number}"
        return FileFormatError(f"{self._shown}: {self.kind} {name}: {what}")

    def only(self, owner: str, *keys: str, allowed: bool) -> None:
        """Refuse keys that make no sense in an entry of this sort."""
        for key in keys:
            if key in self._content and not allowed:
                raise self.wrong(f"{owner} has no {key}")

    def all_read(self) -> None:
        """Refuse keys that nobody asked for."""
        unknown = sorted(set(self._content) - self._known)
        if unknown:
            raise self.wrong(f"the key {unknown[0]!r} is not known")

    def text(self, key: str, *, required: bool = True) -> str:
        """Return a text that is not empty, or nothing where it may be absent."""
        value: str = self._value(key, str, "a text", "" if not required else None)
        if required and not value.strip():
            raise self.wrong(f"{key} is empty")
        return value

    def flag(self, key: str, *, default: bool | None = None) -> bool:
        """Return true or false."""
        value: bool = self._value(key, bool, "true or false", default)
        return value

    def choice(self, key: str, allowed: Sequence[str]) -> Any:
        """Return one of these words."""
        word = self.text(key)
        if word not in allowed:
            raise self.wrong(f"{key} {word!r} is not one of {', '.join(allowed)}")
        return word

    def table(self, key: str, *, required: bool = True) -> dict[str, Any]:
        """Return a table, an empty one where it may be absent."""
        value: dict[str, Any] = self._value(key, dict, "a table", {} if not required else None)
        return value

    def data(self, key: str) -> bytes:
        """Return at least one byte from hexadecimal digits in any spacing."""
        return self._data(key, self.text(key))

    def data_list(self, key: str) -> tuple[bytes, ...]:
        """Return a list of byte strings, which may be empty."""
        values: list[Any] = self._value(key, list, "a list", None)
        if not all(isinstance(value, str) for value in values):
            raise self.wrong(f"{key} is not a list of texts")
        return tuple(self._data(key, value) for value in values)

    def _data(self, key: str, digits: str) -> bytes:
        try:
            data = bytes.fromhex(digits)
        except ValueError as error:
            raise self.wrong(f"{key} is no hexadecimal: {error}") from None
        if not data:
            raise self.wrong(f"{key} is empty")
        return data

    def _value(self, key: str, kind: type, name: str, default: Any) -> Any:
        self._known.add(key)
        if key not in self._content:
            if default is None:
                raise self.wrong(f"the key {key!r} is missing")
            return default
        value = self._content[key]
        if type(value) is not kind:
            raise self.wrong(f"{key} is not {name}")
        return value
