"""TOML files of the user: strict reading with file, line and key in every error, and safe replacement.

    top = read_toml(path, "a plant")
    given = top.take({"format": WHOLE, "drive": TABLES}, "format")
    for drive in top.tables("drive"):
        drive.take({"name": TEXT, "armed": CHOICE})

Text is UTF-8, with or without a byte order mark, with any kind of line ends.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.errors import FileFormatError, unknown_key

if TYPE_CHECKING:
    from collections.abc import Callable
    from importlib.resources.abc import Traversable

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|([A-Za-z0-9_-]+))\s*=""")
_BLOCK = 4096
_LARGEST = 2**63
"""Largest number accepted in a file. Larger ones are too much for a float."""


class Kind(NamedTuple):
    """Type of a key's value: its Python types, and the words for it in an error message."""

    types: tuple[type, ...]
    words: str


TEXT = Kind((str,), "a text in quotes")
RAW = Kind((int, str), "a whole number, or a text in quotes")
WHOLE = Kind((int,), "a whole number")
NUMBER = Kind((int, float), "a number")
DECIMAL = Kind((int, float, str), "a number, or its digits in quotes")
SECONDS = Kind((int, float), "seconds")
CHOICE = Kind((bool,), "true or false")
TABLE = Kind((dict,), "a table in braces, such as { key = value }")
SWITCH = Kind((bool, dict), "true, false, or a table in braces, such as { key = value }")
LIST = Kind((list,), 'a list, such as ["one", "two"]')
TABLES = Kind((list,), "a table of its own each time, under a header in double brackets")


class LinePositions:
    """Line numbers of the tables and keys of a file. Inline and multi-line values have the line of their key."""

    def __init__(self, text: str) -> None:
        self._text = text

    @cached_property
    def _lines(self) -> dict[tuple[str, int, str], int]:
        # Computed at the first error, because a correct file never needs it.
        lines: dict[tuple[str, int, str], int] = {}
        counted: dict[str, int] = {}
        table, number = "", 0
        for line, content in enumerate(self._text.splitlines(), start=1):
            if header := _HEADER.match(content):
                table = header[2]
                number = counted[table] = counted.get(table, -1) + 1
                lines.setdefault((table, number, ""), line)
            elif key := _KEY.match(content):
                lines.setdefault((table, number, key[1] or key[2] or key[3]), line)
        return lines

    def of(self, table: str, number: int = 0, key: str = "") -> int:
        """Return the line, counted from 1, of a key in a table, or of the table itself if no key is given.

        table: name of the table. number: its position among tables of this name, from 0. The line of an absent key is
        that of its table; the line of an absent table is 1.
        """
        whole = self._lines.get((table, number, ""), 1)
        return self._lines.get((table, number, key), whole)


class TomlTable:
    """One table of a file; its errors name the file, the line, the table and the key.

    content: the keys and values. line_of: returns the line of a key; None for a text without lines. name: name of the
    table in error messages, such as "drive 2 (pump)"; empty for the file as a whole. places: lines of the tables below;
    only for the top table of a file. source: the bytes of the file; only for its top table.
    """

    def __init__(
        self,
        content: Mapping[str, Any],
        shown: str,
        line_of: Callable[[str], int] | None = None,
        name: str = "",
        places: LinePositions | None = None,
        *,
        source: bytes = b"",
    ) -> None:
        self.content = content
        self.source = source
        self.name = name
        self._shown = shown
        self._line_of = line_of
        self._places = places

    def error(self, what: str, key: str = "") -> FileFormatError:
        """Return an error about this table, or about one key of it."""
        place = f"{self._shown}, line {self._line_of(key)}" if self._line_of else self._shown
        return FileFormatError(": ".join(each for each in (place, self.name, what) if each))

    def take(self, known: Mapping[str, Kind], *needed: str) -> dict[str, Any]:
        """Return the content of the table. Raises FileFormatError for an unknown, missing or wrong key."""
        for key in sorted(set(self.content) - set(known)):
            raise self.error(unknown_key(key, known), key)
        for key in needed:
            if key not in self.content:
                raise self.error(f"the key {key!r} is missing; write {key} = {known[key].words}")
        for key, value in self.content.items():
            kind = known[key]
            if not isinstance(value, kind.types) or (isinstance(value, bool) and bool not in kind.types):
                raise self.error(f"invalid {key} = {value!r}; write {kind.words}", key)
            if isinstance(value, int) and abs(value) > _LARGEST:
                raise self.error(f"{key} is too large a number", key)
        return dict(self.content)

    def beside(self, path: str) -> Path:
        """Return the path of a file that this file names: relative to this file's folder, unless it is absolute."""
        return Path(self._shown).parent / path

    def without(self, key: str, name: str = "") -> TomlTable:
        """Return the same table without one key. name: its new name in error messages, if any."""
        rest = {each: value for each, value in self.content.items() if each != key}
        return TomlTable(rest, self._shown, self._line_of, name or self.name, self._places)

    def replaced(self, key: str, value: object) -> TomlTable:
        """Return the same table with another value for a key."""
        return TomlTable({**self.content, key: value}, self._shown, self._line_of, self.name, self._places)

    def table(self, key: str) -> TomlTable:
        """Return the table under a key; an empty one if the key is missing."""
        found = self.content.get(key, {})
        if not isinstance(found, dict):
            raise self.error(f"invalid {key} = {found!r}; write {TABLE.words}", key)
        name = f"{self.name}, {key}" if self.name else key
        places = self._places
        if places is not None:
            return TomlTable(found, self._shown, lambda inner: places.of(key, 0, inner) if found else 1, name)
        return TomlTable(found, self._shown, self._at(key), name)

    def tables(self, key: str) -> list[TomlTable]:
        """Return the tables under a key: each [[key]] of a file, or each table of an inline list."""
        found = self.content.get(key, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            raise self.error(f"write {key} as tables: [[{key}]] and the keys below, for each", key)
        return [self._numbered(key, number, each) for number, each in enumerate(found)]

    def _numbered(self, key: str, number: int, content: Mapping[str, Any]) -> TomlTable:
        own = content.get("name")
        name = f"{key} {number + 1} ({own})" if isinstance(own, str) and own else f"{key} {number + 1}"
        places = self._places
        if places is not None:
            return TomlTable(content, self._shown, lambda inner: places.of(key, number, inner), name)
        return TomlTable(content, self._shown, self._at(key), f"{self.name}, {name}" if self.name else name)

    def _at(self, key: str) -> Callable[[str], int] | None:
        line_of = self._line_of
        return None if line_of is None else lambda _: line_of(key)


def read_text_file(path: Path | Traversable, what: str, *, shown: str = "") -> str:
    """Return the text of a file. Raises FileFormatError if the file is missing, unreadable or not UTF-8.

    what: kind of file, such as "a plant". shown: name of the file in error messages; its path unless given.
    """
    return _read(path, what, shown or str(path))[1]


def _read(path: Path | Traversable, what: str, name: str) -> tuple[bytes, str]:
    """Return the bytes of a file and its text."""
    try:
        source = path.read_bytes()
        return source, source.decode("utf-8-sig")
    except FileNotFoundError:
        raise FileFormatError(no_such_file(name)) from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise FileFormatError(
            f"{name}, line {line}: cannot be read as {what}: it is not in UTF-8; save the file in UTF-8"
        ) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else ""
        raise FileFormatError(f"{name}: cannot be read as {what}: {reason or error}") from error


def read_toml(
    path: Path | Traversable, what: str, *, shown: str = "", parse_float: Callable[[str], Any] = float
) -> TomlTable:
    """Return the top table of a TOML file. Raises FileFormatError as `read_text_file` does."""
    name = shown or str(path)
    source, text = _read(path, what, name)
    content = parse_toml(text, f"{name}: cannot be read as {what}", parse_float=parse_float)
    places = LinePositions(text)
    return TomlTable(content, name, lambda key: places.of("", 0, key), places=places, source=source)


def parse_toml(text: str, refusal: str, *, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """Return the content of a TOML text. Raises FileFormatError, starting with `refusal`, if the text is not TOML."""
    import tomllib

    try:
        return tomllib.loads(text, parse_float=parse_float)
    except (ValueError, ArithmeticError, RecursionError) as error:
        raise FileFormatError(f"{refusal}: {error}") from error


def no_such_file(name: object) -> str:
    """Return the message for a missing file."""
    return f"{name}: there is no such file"


def toml_line(key: object, value: Any) -> str:
    """Return `key = value`, with nested values inline. Raises TypeError for a value that TOML cannot express."""
    return f"{_key(key)} = {toml_value(value)}"


def toml_value(value: Any) -> str:
    """Return a value in TOML notation, on one line. Raises TypeError for a value that TOML cannot express."""
    import tomli_w

    if isinstance(value, Mapping):
        inside = ", ".join(toml_line(key, each) for key, each in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return tomli_w.dumps({"k": value}).removeprefix("k = ").rstrip("\n")


def _key(key: object) -> str:
    import tomli_w

    return tomli_w.dumps({str(key): 0}).removesuffix(" = 0\n")


def write_atomically(path: Path, text: str, *, mode: int | None = None) -> None:
    """Write a file atomically: after any failure, either the old or the new file is there, complete.

    The owner and group stay, if this user may give files away. mode: permission bits; by default those of the old file,
    or the usual ones for a new file. Raises FileFormatError if the file cannot be written.
    """
    import tempfile

    # Write the target of a symbolic link, so that the link itself stays.
    path = path.resolve()
    if path.exists() and not path.is_file():
        raise FileFormatError(f"{path}: cannot be written: it is not a file")
    try:
        handle, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            _give_to_its_owner(beside, path)
            Path(beside).chmod(_mode(path) if mode is None else mode)
            Path(beside).replace(path)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from error


def must_be_writable(path: Path) -> None:
    """Raise FileFormatError if `write_atomically` could not write this file now. Call it before minutes of work."""
    import tempfile

    folder = path.resolve().parent
    if path.exists() and not path.is_file():
        return
    if not folder.is_dir():
        raise FileFormatError(f"{path}: there is no folder {path.parent}; make it first")
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as beside:
            # On a full disk files can be created, but not filled.
            beside.write(bytes(_BLOCK))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from error


def _give_to_its_owner(beside: str, path: Path) -> None:
    if os.name != "posix" or not path.exists():
        return
    before, now = path.stat(), Path(beside).stat()
    # The system call filter of a service forbids even an attempt that changes nothing.
    if (before.st_uid, before.st_gid) != (now.st_uid, now.st_gid):
        with suppress(OSError):
            os.chown(beside, before.st_uid, before.st_gid)


def _mode(path: Path) -> int:
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
