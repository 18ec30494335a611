"""One table of a vector file, read key by key; whatever is wrong is named with file and id."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Entry:
    """A table of a vector file; remembers which of its keys were asked for.

    shown: the file as messages name it. kind: what sort of table it is. name: which one of them.
    """

    def __init__(self, shown: str, kind: str, name: str, content: Mapping[str, Any]) -> None:
        self.kind = kind
        self.id = ""
        self._shown = shown
        self._name = name
        self._content = content
        self._known: set[str] = set()

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def named(self) -> Entry:
        """Take the name from the key `id`, which must be there; returns the entry itself."""
        self.id = self.text("id")
        self._name = self.id
        return self

    def wrong(self, what: str) -> FileFormatError:
        """Return the error that says what is wrong with this entry."""
        return FileFormatError(f"{self._shown}: {self.kind} {self._name}: {what}")

    def only(self, owner: str, *keys: str, allowed: bool) -> None:
        """Refuse keys that make no sense in an entry of this sort."""
        for key in keys:
            if key in self._content and not allowed:
                raise self.wrong(f"{owner} has no {key}")

    def one_of(self, keys: Sequence[str]) -> str:
        """Return the one of these keys that is there; it must be exactly one."""
        found = [key for key in keys if key in self._content]
        if len(found) != 1:
            raise self.wrong(f"has exactly one of {', '.join(keys)}")
        return found[0]

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

    def whole(self, key: str) -> int:
        """Return a whole number."""
        value: int = self._value(key, int, "a whole number", None)
        return value

    def seconds(self, key: str) -> float | None:
        """Return a time that is not negative, None where it is absent."""
        self._known.add(key)
        if key not in self._content:
            return None
        value = self._content[key]
        if type(value) not in (int, float) or not 0 <= value < 1e9:
            raise self.wrong(f"{key} is no time in seconds, from 0 to 1e9")
        return float(value)

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

    def parts(self, key: str, name: str) -> list[Entry]:
        """Return a list of tables, at least one, each as an entry of its own that messages call by this name."""
        tables: list[Any] = self._value(key, list, "a list", None)
        if not tables:
            raise self.wrong(f"{key} is empty")
        if not all(isinstance(table, dict) for table in tables):
            raise self.wrong(f"{key} is not a list of tables")
        return [
            Entry(self._shown, self.kind, f"{self._name}, {name} {number}", table)
            for number, table in enumerate(tables, 1)
        ]

    def is_empty_list(self, key: str) -> bool:
        """Whether a list is there and has nothing in it."""
        self._known.add(key)
        return bool(self._content.get(key) == [])

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
