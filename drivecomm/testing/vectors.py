"""Vector files: facts about the wire as TOML, read strictly.

    format = 2
    protocol = "vabus"

    [[vector]]            one telegram, its fields and its special properties
    [[stream]]            bytes as they arrive, and the telegrams that must be found in them
    [[refuse]]            fields that an encoder must refuse
    [[exchange]]          a conversation: calls of the master, steps on the wire, and the result

A file with an unknown key is refused, so that a misspelt key never disables a check.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.errors import Category
from drivecomm.testing.entry import VectorEntry
from drivecomm.testing.exchange_vectors import ExchangeVector, read_exchange
from drivecomm.tomlfile import CHOICE, LIST, TABLE, TABLES, TEXT, WHOLE, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from importlib.resources.abc import Traversable

    from drivecomm.protocol import Direction, Protocol
    from drivecomm.tomlfile import TomlTable

FORMAT = 2
"""Format version of the vector files that this module reads."""

CATEGORIES: tuple[Category, ...] = get_args(Category)
"""Reasons for which an invalid telegram can be refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """One telegram, and the result that a decoder and an encoder must produce.

    canonical: an encoder produces exactly these bytes. options: the protocol's options for the decoder. reply_expected:
    whether a request expects a reply. answers_to: the request of a reply. answers: whether this reply answers that
    request. mismatch: the reason if it does not. error: the category in which an invalid telegram is refused. meaning:
    how the higher layers interpret the telegram. The other fields are for the reader.
    """

    id: str
    source: str
    direction: Direction
    data: bytes
    valid: bool
    printed: bool = False
    canonical: bool = True
    options: Mapping[str, Any] = field(default_factory=dict)
    fields: Mapping[str, Any] = field(default_factory=dict)
    meaning: Mapping[str, Any] = field(default_factory=dict)
    reply_expected: bool = True
    answers_to: bytes | None = None
    answers: bool = True
    mismatch: str = ""
    error: Category | None = None
    reason: str = ""
    ascii: str = ""
    printed_words: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """Bytes as they arrive, and the telegrams that a reader of the stream must find, in order."""

    id: str
    direction: Direction
    data: bytes
    frames: tuple[bytes, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refuse:
    """Fields that an encoder must refuse, and why."""

    id: str
    direction: Direction
    fields: Mapping[str, Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    source: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorFile:
    """Content of one vector file. name: as in checks and messages."""

    name: str
    protocol: str
    vectors: tuple[Vector, ...] = ()
    streams: tuple[Stream, ...] = ()
    refusals: tuple[Refuse, ...] = ()
    exchanges: tuple[ExchangeVector, ...] = ()


def load_vectors(path: str | Path, *, protocol: str | None = None) -> VectorFile:
    """Return the content of a vector file. protocol: the protocol that the file must be for; any if absent.

    Raises FileFormatError that names the file, the entry and the mistake.
    """
    return _read(Path(path), str(path), protocol)


def packaged_vectors(plugin: Protocol) -> VectorFile:
    """Return the vectors that a protocol package ships; they are read once and cached.

    Raises FileFormatError if there are none or they are invalid.
    """
    return _packaged(plugin.package, plugin.name)


@lru_cache
def _packaged(package: str, protocol: str) -> VectorFile:
    return _read(resources.files(package) / "vectors.toml", f"{package}/vectors.toml", protocol)


def _read(place: Path | Traversable, shown: str, protocol: str | None) -> VectorFile:
    top = read_toml(place, "a vector file", shown=shown)
    if type(top.content.get("format")) is not int or top.content["format"] != FORMAT:
        raise top.error(f"a vector file begins with format = {FORMAT}", "format")
    given = top.take({"format": WHOLE, "protocol": TEXT, **dict.fromkeys(_READERS, TABLES)}, "protocol")
    if not given["protocol"]:
        raise top.error("a vector file names its protocol", "protocol")
    if protocol is not None and given["protocol"] != protocol:
        raise top.error(f"holds vectors of {given['protocol']!r}, not of {protocol!r}", "protocol")
    seen: set[str] = set()
    read: dict[str, tuple[Any, ...]] = {}
    for kind, (attribute, reader) in _READERS.items():
        read[attribute] = tuple(reader(_with_id(table, kind, seen)) for table in top.tables(kind))
    return VectorFile(name=place.name, protocol=given["protocol"], **read)


def _with_id(table: TomlTable, kind: str, seen: set[str]) -> TomlTable:
    """Return a table whose id names it in messages; the id must be unique."""
    found = table.content.get("id")
    if isinstance(found, str) and found.strip():
        if found in seen:
            raise table.error(f"the id {found!r} is used twice", "id")
        seen.add(found)
        table.name = f"{kind} {found}"
    return table


_VECTOR = {
    **dict.fromkeys(("id", "source", "direction", "hex", "answers_to", "mismatch", "error", "reason"), TEXT),
    **dict.fromkeys(("ascii", "printed_words", "note"), TEXT),
    **dict.fromkeys(("valid", "printed", "canonical", "reply_expected", "answers"), CHOICE),
    **dict.fromkeys(("options", "fields", "meaning"), TABLE),
}
_STREAM = {**dict.fromkeys(("id", "direction", "hex", "source", "note"), TEXT), "frames": LIST, "options": TABLE}
_REFUSE = {**dict.fromkeys(("id", "direction", "reason", "source", "note"), TEXT), "fields": TABLE, "options": TABLE}
_DIRECTIONS = ("request", "reply")


def _vector(table: TomlTable) -> Vector:
    valid = table.content.get("valid") is not False
    needed = ["id", "source", "direction", "hex", "valid", "fields" if valid else "error"]
    entry = VectorEntry(table, _VECTOR, *needed, *(["answers"] if "answers_to" in table.content else []))
    given, direction = entry.given, entry.choice("direction", _DIRECTIONS)
    entry.only("a valid telegram", "error", allowed=not valid)
    entry.only("a refused telegram", "fields", "meaning", "canonical", "answers_to", allowed=valid)
    entry.only("a reply", "reply_expected", allowed=direction == "request")
    entry.only("a request", "answers_to", allowed=direction == "reply")
    entry.only("a vector without answers_to", "answers", allowed="answers_to" in given)
    entry.only("a reply that is the answer", "mismatch", allowed=not given.get("answers", True))
    if not given.get("answers", True) and not given.get("mismatch"):
        raise entry.error("answers = false needs mismatch, which says why", "answers")
    if "error" in given:
        entry.choice("error", CATEGORIES)
    if "answers_to" in given:
        given["answers_to"] = entry.data("answers_to")
    return Vector(data=entry.data("hex"), **given)


def _stream(table: TomlTable) -> Stream:
    entry = VectorEntry(table, _STREAM, "id", "direction", "hex", "frames")
    entry.choice("direction", _DIRECTIONS)
    return Stream(data=entry.data("hex"), frames=entry.data_list("frames"), **entry.given)


def _refuse(table: TomlTable) -> Refuse:
    entry = VectorEntry(table, _REFUSE, "id", "direction", "fields")
    entry.choice("direction", _DIRECTIONS)
    return Refuse(**entry.given)


_READERS: dict[str, tuple[str, Callable[[TomlTable], Any]]] = {
    "vector": ("vectors", _vector),
    "stream": ("streams", _stream),
    "refuse": ("refusals", _refuse),
    "exchange": ("exchanges", read_exchange),
}
