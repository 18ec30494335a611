"""Schema of a model file, for every protocol: its tables, their keys, and the allowed values.

`drivecomm.models.files` refuses a file at the first mistake; `drivecomm.models.check` lists all of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.errors import unknown_key
from drivecomm.protocol import (
    Access,
    LinkLoss,
    MadeFrom,
    PanelSetting,
    ParameterInfo,
    ParameterKind,
    Purpose,
    Storage,
    Sureness,
    Watchdog,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

FORMAT = 1
TABLES = ("options", "quantities", "watchdog", "identified_by", "faults", "warnings", "control", "sources", "proofs")
"""Tables of a model file, apart from its parameters."""

TEXTS = ("name", "title", "extends", "source", "link_loss")
"""Keys of a model file whose values are texts."""

TEXT_TYPES = ("string", "text")
"""Types of parameters that hold characters; their `start` is a text."""

PARAMETER_KEYS = frozenset(ParameterInfo.__dataclass_fields__) - {"extra", "proof"}
"""Keys of a parameter that every protocol knows."""

SOURCED = ("commands", "status")
"""Parts of a model's control that have sources of their own."""

EXACT = ("factor", "minimum", "maximum")
PLAIN = ("title", "type", "unit", "access", "storage", "kind", "source", "printed", "second_source", "sure")

_TOP = frozenset({"format", "protocol", "parameter", "setup", "fault_log", *TEXTS, *TABLES})
_WATCHDOG = frozenset(Watchdog.__dataclass_fields__)
PROVED: tuple[Sureness, ...] = ("drive", "contradicted")
"""Marks that only a proof gives."""

_WORDS: dict[str, tuple[str, ...]] = {
    "access": get_args(Access),
    "sure": tuple(word for word in get_args(Sureness) if word not in PROVED),
    "storage": tuple(word for word in get_args(Storage) if word),
    "kind": get_args(ParameterKind),
    "purpose": get_args(Purpose),
    "made_from": get_args(MadeFrom),
    "unit": ("s", "ms"),
}
_PARAMETER_WORDS = ("access", "sure", "storage", "kind")
_SETUP_WORDS = ("purpose", "made_from", "unit", "sure")
_SETUP = frozenset(PanelSetting.__dataclass_fields__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """A mistake in a file, and its place: the table, its number among those of this name, and the key.

    key: empty if the whole table is wrong.
    """

    text: str
    key: str = ""
    table: str = ""
    number: int = 0

    def __str__(self) -> str:
        return f"{self.key}: {self.text}" if self.key else self.text


def mistakes_in(content: Mapping[str, Any], protocol: str) -> Iterator[Mistake]:
    """Yield all content of a readable TOML file that is invalid in any model of this protocol."""
    if content.get("format") != FORMAT or isinstance(content["format"], bool):
        yield Mistake(key="format", text=f"a model begins with format = {FORMAT}")
    if content.get("protocol") != protocol:
        yield Mistake(key="protocol", text=f"is a model for {content.get('protocol')!r}, not for {protocol!r}")
    for key in sorted(set(content) - _TOP):
        yield Mistake(key=key, text=unknown_key(key, sorted(_TOP)))
    if "name" not in content:
        yield Mistake(text="the key 'name' is missing")
    for key in TEXTS:
        if key in content and (not isinstance(content[key], str) or not (content[key] or key == "source")):
            yield Mistake(key=key, text=f"{content[key]!r} is not a text")
    log = content.get("fault_log", [])
    if not isinstance(log, list) or not all(isinstance(address, str) and address for address in log):
        text = 'names parameters by their addresses, the newest fault first: fault_log = ["15-30[0]", "15-30[1]"]'
        yield Mistake(key="fault_log", text=text)
    for name in TABLES:
        if not isinstance(content.get(name, {}), dict):
            yield Mistake(key=name, text=f"is not a table; write [{name}] and its keys below")
        elif name in content and name in _TABLE_RULES:
            yield from _TABLE_RULES[name](name, content[name])
    yield from _in_rows(content, "parameter", "parameters", _in_parameter)
    yield from _in_rows(content, "setup", "panel settings", _in_setup)


def _in_rows(
    content: Mapping[str, Any], key: str, what: str, rule: Callable[[Mapping[str, Any]], Iterator[Mistake]]
) -> Iterator[Mistake]:
    rows = content.get(key, [])
    if not isinstance(rows, list) or not all(isinstance(each, dict) for each in rows):
        yield Mistake(key=key, text=f"{what} are tables; write [[{key}]] and its keys below")
        return
    for number, row in enumerate(rows):
        for mistake in rule(row):
            yield replace(mistake, table=key, number=number)


def number_in(value: Any) -> Decimal | None:
    """Return the exact number that a file gives as a text or a TOML number; None if it is not a number."""
    try:
        found = Decimal(str(value))
    except InvalidOperation:
        return None
    return found if found.is_finite() and not isinstance(value, bool) else None


def code_in(value: str) -> int | None:
    """Return the whole number that a key stands for, such as 16 or 0x10; None if it is not a number."""
    try:
        return int(value, 16 if value.startswith("0x") else 10)
    except ValueError:
        return None


def _addresses(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    for name, address in given.items():
        if not isinstance(address, str):
            yield Mistake(table=table, key=name, text=f"{address!r} is not a parameter address; write it as a text")


def _texts_by_code(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    seen: dict[int, str] = {}
    for code, text in given.items():
        number = code_in(code)
        if number is None:
            yield Mistake(table=table, key=code, text=f"{code!r} is not a whole number")
        elif (other := seen.setdefault(number, code)) != code:
            yield Mistake(table=table, key=code, text=f"{code!r} is the same as {other!r}")
        elif not isinstance(text, str):
            yield Mistake(table=table, key=code, text=f"{text!r} is not a text")


def _patterns(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    for key, pattern in given.items():
        try:
            re.compile(pattern)
        except (TypeError, re.error) as error:
            yield Mistake(table=table, key=key, text=f"{pattern!r} is not a regular expression: {error}")


def _watchdog(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    for key in sorted(set(given) - _WATCHDOG):
        yield Mistake(table=table, key=key, text=unknown_key(key, sorted(_WATCHDOG)))
    if not isinstance(given.get("time"), str):
        yield Mistake(table=table, key="time", text="a watchdog names the parameter with its time")
    if "fault" in given and type(given["fault"]) is not int:
        yield Mistake(table=table, key="fault", text=f"{given['fault']!r} is not a fault code")
    actions = given.get("actions", {})
    if not isinstance(actions, dict) or not all(
        key in get_args(LinkLoss) and type(value) is int for key, value in actions.items()
    ):
        yield Mistake(table=table, key="actions", text=f"has whole numbers for some of {', '.join(get_args(LinkLoss))}")
    for key, kind in {"action": str, "source": str, "second_source": str, "note": str, "off": int}.items():
        if key in given and type(given[key]) is not kind:
            yield Mistake(table=table, key=key, text=f"invalid value {given[key]!r}")
    yield from _words(given, ("sure",), table)


def _sources(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    for key, documents in given.items():
        if key not in SOURCED:
            yield Mistake(table=table, key=key, text=unknown_key(key, SOURCED))
        elif not isinstance(documents, list) or not all(isinstance(each, str) and each for each in documents):
            yield Mistake(table=table, key=key, text='names documents or programs: ["manual p. 3", "another p. 5"]')


def _proofs(table: str, given: Mapping[str, Any]) -> Iterator[Mistake]:
    for address, entry in given.items():
        if not isinstance(entry, dict) or entry.keys() != {"sure", "proof"}:
            text = 'says what a proof has shown: { sure = "drive", proof = "proofs/name.toml" }'
            yield Mistake(table=table, key=address, text=text)
        elif entry["sure"] not in PROVED:
            yield Mistake(table=table, key=address, text=f"sure is one of {', '.join(PROVED)}")
        elif not isinstance(entry["proof"], str) or not entry["proof"]:
            yield Mistake(table=table, key=address, text="proof names the report")


# Options depend on the protocol, so they are not checked here.
_TABLE_RULES = {
    "quantities": _addresses,
    "watchdog": _watchdog,
    "identified_by": _patterns,
    "faults": _texts_by_code,
    "warnings": _texts_by_code,
    "sources": _sources,
    "proofs": _proofs,
}


def _in_parameter(entry: Mapping[str, Any]) -> Iterator[Mistake]:
    for key in ("address", "name"):
        if key not in entry:
            yield Mistake(text=f"parameter: the key {key!r} is missing")
        elif not isinstance(entry[key], str) or not entry[key]:
            yield Mistake(key=key, text=f"{entry[key]!r} is not a text")
    for key in EXACT:
        if key in entry and number_in(entry[key]) is None:
            yield Mistake(key=key, text=f"{entry[key]!r} is not a number")
    if number_in(entry.get("factor")) == 0:
        yield Mistake(key="factor", text="no value can be made from steps of 0")
    for key in PLAIN:
        if key in entry and not isinstance(entry[key], str):
            yield Mistake(key=key, text=f"{entry[key]!r} is not a text")
    yield from _words(entry, _PARAMETER_WORDS)
    values = entry.get("values", {})
    if not isinstance(values, dict):
        yield Mistake(key="values", text="is not a table of numbers and texts")
    else:
        for mistake in _texts_by_code("", values):
            yield replace(mistake, key="values")
    only_with = entry.get("only_with", {})
    lists = list(only_with.values()) if isinstance(only_with, dict) else [only_with]
    if not all(isinstance(codes, list) and codes and all(type(code) is int for code in codes) for codes in lists):
        text = 'names other parameters, each with a list of the raw values that let this one count: { "8-04" = [2, 5] }'
        yield Mistake(key="only_with", text=text)
    if "start" in entry:
        is_text = entry.get("type") in TEXT_TYPES
        if not isinstance(entry["start"], str) if is_text else number_in(entry["start"]) is None:
            yield Mistake(key="start", text=f"{entry['start']!r} is not a {'text' if is_text else 'number'}")


def _in_setup(row: Mapping[str, Any]) -> Iterator[Mistake]:
    for key in sorted(set(row) - _SETUP):
        yield Mistake(key=key, text=unknown_key(key, sorted(_SETUP)))
    for key in ("parameter", "name", "purpose"):
        if not row.get(key):
            yield Mistake(text=f"setup: the key {key!r} is missing")
    if ("value" in row) == ("made_from" in row):
        yield Mistake(text="setup: write either value, or made_from for what it is made from in the plant")
    codes, also = row.get("codes", {}), row.get("also", [])
    if not isinstance(codes, dict) or not all(isinstance(each, str) and each for each in codes.values()):
        yield Mistake(key="codes", text='has the panel\'s value for each of the plant: { 9600 = "6", 19200 = "7" }')
    if not isinstance(also, list) or not all(isinstance(each, str) and each for each in also):
        yield Mistake(key="also", text='has further values that do as well: ["4"]')
    for key in _SETUP - {"codes", "also", "hexadecimal"}:
        if key in row and not isinstance(row[key], str):
            yield Mistake(key=key, text=f"{row[key]!r} is not a text")
    if not isinstance(row.get("hexadecimal", False), bool):
        yield Mistake(key="hexadecimal", text="is true or false")
    yield from _words(row, _SETUP_WORDS)


def _words(entry: Mapping[str, Any], keys: Iterable[str], table: str = "") -> Iterator[Mistake]:
    for key in keys:
        words = _WORDS[key]
        if key in entry and entry[key] not in words:
            yield Mistake(table=table, key=key, text=f"invalid value {entry[key]!r}; it is one of {', '.join(words)}")
