"""Vector files: facts about the wire as TOML, read strictly.

    format = 2
    protocol = "vabus"

    [[vector]]            one telegram, its fields, and what is special about it
    [[stream]]            bytes as they arrive, and the telegrams that must be found in them
    [[refuse]]            fields that an encoder must refuse
    [[exchange]]          a conversation: calls on this side, steps on the wire, and what comes of it

A file that says something a reader does not know is refused, so that a misspelt key never makes a check disappear.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.errors import Category, FileFormatError
from drivecomm.testing.entry import Entry
from drivecomm.testing.exchange_vectors import ExchangeVector, read_exchange
from drivecomm.tomlfile import read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from importlib.resources.abc import Traversable

    from drivecomm.protocol import Direction, Protocol

FORMAT = 2
"""The format of vector files that is read and written."""

CATEGORIES: tuple[Category, ...] = get_args(Category)
"""The categories in which an invalid telegram is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """One telegram and what a decoder and an encoder must make of it.

    canonical: an encoder gives exactly these bytes. options: the protocol's, for the decoder. reply_expected: for
    requests. answers_to: for replies, the request; answers: whether this is its answer; mismatch: why not. error: the
    category in which an invalid one is refused. meaning: what the layers above make of it. The rest is for the reader.
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
    """The content of one vector file. name: as checks and messages call it."""

    name: str
    protocol: str
    vectors: tuple[Vector, ...] = ()
    streams: tuple[Stream, ...] = ()
    refusals: tuple[Refuse, ...] = ()
    exchanges: tuple[ExchangeVector, ...] = ()


def load_vectors(path: str | Path, *, protocol: str | None = None) -> VectorFile:
    """Return what a vector file holds. protocol: the one that it must be for, any if absent.

    Raises FileFormatError that names the file, the entry and what is wrong with it.
    """
    place = Path(path)
    return _read(place, place.name, str(place), protocol)


def packaged_vectors(plugin: Protocol) -> VectorFile:
    """Return the vectors that a protocol package ships, read once.

    Raises FileFormatError when it ships none or they are wrong.
    """
    return _packaged(plugin.package, plugin.name)


@lru_cache
def _packaged(package: str, protocol: str) -> VectorFile:
    name = "vectors.toml"
    return _read(resources.files(package) / name, name, f"{package}/{name}", protocol)


def _read(place: Path | Traversable, name: str, shown: str, protocol: str | None) -> VectorFile:
    content = read_toml(place, "a vector file", shown=shown).content
    if type(content.get("format")) is not int or content["format"] != FORMAT:
        raise FileFormatError(f"{shown}: a vector file begins with format = {FORMAT}")
    named = content.get("protocol")
    if not isinstance(named, str) or not named:
        raise FileFormatError(f"{shown}: a vector file names its protocol")
    if protocol is not None and named != protocol:
        raise FileFormatError(f"{shown}: holds vectors of {named!r}, not of {protocol!r}")
    readers: dict[str, Callable[[Entry], Any]] = {
        "vector": _vector,
        "stream": _stream,
        "refuse": _refuse,
        "exchange": read_exchange,
    }
    unknown = sorted(set(content) - {"format", "protocol", *readers})
    if unknown:
        raise FileFormatError(f"{shown}: the key {unknown[0]!r} is not known")
    entries = [
        Entry(shown, kind, f"number {number}", table).named()
        for kind in readers
        for number, table in enumerate(_tables(shown, kind, content.get(kind, [])), 1)
    ]
    _each_id_once(shown, entries)
    read = {kind: tuple(reader(entry) for entry in entries if entry.kind == kind) for kind, reader in readers.items()}
    return VectorFile(
        name=name,
        protocol=named,
        vectors=read["vector"],
        streams=read["stream"],
        refusals=read["refuse"],
        exchanges=read["exchange"],
    )


def _tables(shown: str, kind: str, given: object) -> list[dict[str, Any]]:
    if not isinstance(given, list) or not all(isinstance(each, dict) for each in given):
        raise FileFormatError(f"{shown}: {kind} is written [[{kind}]]")
    return given


def _each_id_once(shown: str, entries: list[Entry]) -> None:
    seen: set[str] = set()
    for entry in entries:
        if entry.id in seen:
            raise FileFormatError(f"{shown}: the id {entry.id!r} is there twice")
        seen.add(entry.id)


def _direction(entry: Entry) -> Direction:
    direction: Direction = entry.choice("direction", ("request", "reply"))
    return direction


def _vector(entry: Entry) -> Vector:
    valid, direction = entry.flag("valid"), _direction(entry)
    vector = Vector(
        id=entry.id,
        source=entry.text("source"),
        direction=direction,
        data=entry.data("hex"),
        valid=valid,
        printed=entry.flag("printed", default=False),
        canonical=entry.flag("canonical", default=True),
        options=entry.table("options", required=False),
        fields=entry.table("fields", required=valid),
        meaning=entry.table("meaning", required=False),
        reply_expected=entry.flag("reply_expected", default=True),
        answers_to=entry.data("answers_to") if "answers_to" in entry else None,
        answers=entry.flag("answers") if "answers_to" in entry else True,
        mismatch=entry.text("mismatch", required=False),
        error=None if valid else entry.choice("error", CATEGORIES),
        reason=entry.text("reason", required=False),
        ascii=entry.text("ascii", required=False),
        printed_words=entry.text("printed_words", required=False),
        note=entry.text("note", required=False),
    )
    entry.only("a valid telegram", "error", allowed=not valid)
    entry.only("a refused telegram", "fields", "meaning", "canonical", "answers_to", allowed=valid)
    entry.only("a reply", "reply_expected", allowed=direction == "request")
    entry.only("a request", "answers_to", allowed=direction == "reply")
    entry.only("a vector without answers_to", "answers", allowed="answers_to" in entry)
    entry.only("a reply that is the answer", "mismatch", allowed=not vector.answers)
    if not vector.answers and not vector.mismatch:
        raise entry.wrong("answers = false needs mismatch, which says why")
    entry.all_read()
    return vector


def _stream(entry: Entry) -> Stream:
    stream = Stream(
        id=entry.id,
        direction=_direction(entry),
        data=entry.data("hex"),
        frames=entry.data_list("frames"),
        options=entry.table("options", required=False),
        source=entry.text("source", required=False),
        note=entry.text("note", required=False),
    )
    entry.all_read()
    return stream


def _refuse(entry: Entry) -> Refuse:
    refuse = Refuse(
        id=entry.id,
        direction=_direction(entry),
        fields=entry.table("fields"),
        options=entry.table("options", required=False),
        reason=entry.text("reason", required=False),
        source=entry.text("source", required=False),
        note=entry.text("note", required=False),
    )
    entry.all_read()
    return refuse
