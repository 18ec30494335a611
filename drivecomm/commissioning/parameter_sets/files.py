"""Parameter sets as files, in TOML, for people and for version control: one line a parameter, always in one order.

format = 1
protocol = "vabus"
drive = "vabus:1"                 # where it was read
model = "agile"
firmware = "5.11"                 # left out where the drive does not tell
time = 2026-11-21T19:00:00Z

[identity]                        # what the drive told of itself
"serial number" = "012345G678"

[settings]
"372[1]" = { name = "rated_speed", value = 1450, unit = "1/min", raw = "05AA" }
"481[1]" = { name = "fixed_frequency_2", value = 10.00, unit = "Hz", raw = "000003E8" }

[communication]                   # address, baud rate and so on: not restored unless told

[measured]                        # never restored

[not_read]
"18" = "it can only be written"

Numbers are exact: what stands behind the point counts as a decimal number, never as a binary one.
"""

from __future__ import annotations

import os
import tempfile
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from drivecomm.commissioning.parameter_sets.parameter_set import PARTS, Entry, ParameterSet, in_order
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import Places, quantities
from drivecomm.tomlfile import read_toml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.protocol import Value

_FORMAT = 1
_HEAD = "# Parameters of a drive: values are physical, raw is what the telegram carried; drivecomm restore writes them."
_TOP = frozenset(
    {"format", "protocol", "drive", "model", "firmware", "time", "identity", "not_read", *PARTS}
)  # fmt: skip
_KEYS: Mapping[str, tuple[type, ...]] = {
    "name": (str,),
    "value": (int, Decimal, str),
    "unit": (str,),
    "raw": (int, str),
    "common": (str,),
}
_MOST_DIGITS = 40
"""No drive holds a number with more; one with millions would keep a program busy for ever."""


def text_of(known: ParameterSet) -> str:
    """Return a parameter set as the text of its file; the same set gives the same text."""
    return "\n".join([_HEAD, *_lines(known), ""])


def entries_text(known: ParameterSet, part: Part = "settings") -> str:
    """Return one part of the text without its comments: two sets with the same parameters have the same bytes."""
    return "\n".join(_line(entry) for entry in _ordered(known, part))


def write_set(path: Path, known: ParameterSet) -> None:
    """Write a parameter set, in place of an older one of the same drive; a file is there whole or not at all.

    Raises UsageError for a file that is anything else, or a place where none can be written.
    """
    must_be_free(path, known.drive)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text_of(known))
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).chmod(_mode(path))
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


def must_be_free(path: Path, drive: str) -> None:
    """Raise UsageError if a file would be lost that is no parameter set of this drive."""
    if not path.exists():
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {path.parent}; make it first")
        return
    try:
        there = read_set(path)
    except FileFormatError as error:
        raise UsageError(f"{path}: there is a file that is no parameter set; give another name") from error
    if there.drive != drive:
        raise UsageError(f"{path}: this is the parameter set of {there.drive}, not of {drive}; give another name")


def read_set(path: Path) -> ParameterSet:
    """Read a parameter set. Raises FileFormatError with the file, the line, the key, and what is wrong there."""
    text, content = read_toml(path, "a parameter set", parse_float=Decimal)
    return _Document(path, text).read(content)


def _mode(path: Path) -> int:
    """Return the rights that the file has, or that a new one gets."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


# Writing


def _lines(known: ParameterSet) -> Iterator[str]:
    yield f"format = {_FORMAT}"
    for key in ("protocol", "drive", "model", "firmware"):
        if text := getattr(known, key):
            yield f"{key} = {_quoted(text)}"
    if known.time is not None:
        yield f"time = {known.time.astimezone(UTC).strftime('%Y-%m-%dT%H:%M:%SZ')}"
    yield from _texts("identity", known.identity, list(known.identity))
    for part in PARTS:
        if entries := _ordered(known, part):
            yield from ("", f"[{part}]", *(_line(entry) + _comment(entry) for entry in entries))
    yield from _texts("not_read", known.not_read, in_order(known.not_read))


def _ordered(known: ParameterSet, part: Part) -> list[Entry]:
    return [known.entries[address] for address in in_order(entry.address for entry in known.of([part]))]


def _texts(table: str, texts: Mapping[str, str], order: list[str]) -> Iterator[str]:
    if texts:
        yield from ("", f"[{table}]", *(f"{_quoted(key)} = {_quoted(texts[key])}" for key in order))


def _line(entry: Entry) -> str:
    fields = {
        "name": entry.name,
        "value": entry.value,
        "unit": entry.unit,
        "raw": entry.raw,
        "common": entry.common,
    }
    told = [f"{key} = {_written(value)}" for key, value in fields.items() if key == "value" or value not in ("", None)]
    return f"{_quoted(entry.address)} = {{ {', '.join(told)} }}"


def _comment(entry: Entry) -> str:
    meaning = " ".join("".join(sign if sign.isprintable() else " " for sign in entry.meaning).split())
    return f" # {meaning}" if meaning else ""


def _written(value: Value | None) -> str:
    if isinstance(value, str):
        return _quoted(value)
    return format(value, "f") if isinstance(value, Decimal) else str(value)


def _quoted(text: str) -> str:
    return '"' + "".join(_escaped(sign) for sign in text) + '"'


def _escaped(sign: str) -> str:
    if sign in '"\\':
        return "\\" + sign
    if sign.isprintable():
        return sign
    return f"\\u{ord(sign):04X}" if ord(sign) < 0x10000 else f"\\U{ord(sign):08X}"


# Reading


class _Document:
    """One file, whose errors name it, the line and the key."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._places = Places(text)

    def read(self, content: Mapping[str, Any]) -> ParameterSet:
        if content.get("format") != _FORMAT:
            self._refuse("", "format", f"a parameter set begins with format = {_FORMAT}")
        for key in sorted(set(content) - _TOP):
            self._refuse("", key, f"no parameter set has this key; it has {', '.join(sorted(_TOP))}")
        for key in ("protocol", "drive", "model"):
            if not isinstance(content.get(key), str) or not content[key]:
                self._refuse("", key, "is missing, or no text; it says where the parameters are from")
        time = content.get("time")
        if time is not None and not (isinstance(time, datetime) and time.tzinfo):
            self._refuse("", "time", f"cannot be {time!r}; write it as 2026-11-21T19:00:00Z")
        firmware = content.get("firmware", "")
        if not isinstance(firmware, str):
            self._refuse("", "firmware", f"{firmware!r} is no text")
        entries: dict[str, Entry] = {}
        for part in PARTS:
            for address, given in self._table(content, part).items():
                if address in entries:
                    self._refuse(part, address, f"stands under [{entries[address].part}] too")
                entries[address] = self._entry(part, address, given)
        return ParameterSet(
            protocol=content["protocol"],
            drive=content["drive"],
            model=content["model"],
            firmware=firmware,
            time=time.astimezone(UTC) if time is not None else None,
            identity=self._texts(content, "identity"),
            entries={address: entries[address] for address in in_order(entries)},
            not_read=self._texts(content, "not_read"),
        )

    def _entry(self, part: Part, address: str, given: Any) -> Entry:
        if not isinstance(given, dict):
            self._refuse(part, address, "write { name = ..., value = ..., unit = ... }")
        for key in sorted(set(given) - set(_KEYS)):
            self._refuse(part, address, f"no parameter has the key {key!r} here; it has {', '.join(_KEYS)}")
        if "value" not in given:
            self._refuse(part, address, "the key 'value' is missing")
        for key, value in given.items():
            if not isinstance(value, _KEYS[key]) or isinstance(value, bool):
                self._refuse(part, address, f"{key} cannot be {value!r}")
        if not _is_sane(given["value"]) or not _is_sane(given.get("raw", 0)):
            self._refuse(part, address, "no drive holds such a number")
        common = given.get("common", "")
        if common and common not in quantities():
            self._refuse(part, address, f"{common!r} is no common name")
        return Entry(address=address, part=part, **given)

    def _table(self, content: Mapping[str, Any], name: str) -> dict[str, Any]:
        found = content.get(name, {})
        if not isinstance(found, dict):
            self._refuse("", name, f"is no table; write [{name}] and its keys below")
        return found

    def _texts(self, content: Mapping[str, Any], table: str) -> dict[str, str]:
        found = self._table(content, table)
        for key, text in found.items():
            if not isinstance(text, str):
                self._refuse(table, key, f"{text!r} is no text")
        return found

    def _refuse(self, table: str, key: str, what: str) -> NoReturn:
        raise FileFormatError(f"{self._path}, line {self._places.of(table, 0, key)}: {key}: {what}")


def _is_sane(value: Value) -> bool:
    if isinstance(value, str):
        return True
    number = Decimal(value)
    return number.is_finite() and abs(number.adjusted()) < _MOST_DIGITS and len(number.as_tuple().digits) < _MOST_DIGITS
