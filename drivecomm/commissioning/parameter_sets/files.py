"""Parameter sets as TOML files, for people and for version control: one line per parameter, in a fixed order.

`docs/how-to/parameter-sets.md` shows an example. Numbers are exact: fractions are decimal, never binary.
"""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.commissioning.parameter_sets.parameter_set import (
    PARTS,
    Approval,
    Explored,
    ParameterEntry,
    ParameterSet,
    in_order,
)
from drivecomm.errors import FileFormatError, UsageError, did_you_mean
from drivecomm.models import quantities
from drivecomm.tomlfile import (
    RAW,
    TABLE,
    TEXT,
    WHOLE,
    Kind,
    TomlTable,
    must_be_writable,
    read_toml,
    toml_line,
    toml_value,
    write_atomically,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.protocol import Value

_FORMAT = 1
_HEAD = "# Parameters of a drive: values are physical, raw is what the telegram carried; drivecomm restore writes them."
_TIME = Kind((datetime,), "a time with its zone, as 2026-11-21T19:00:00Z")
_TOP = {
    "format": WHOLE,
    **dict.fromkeys(("protocol", "drive", "model", "firmware"), TEXT),
    "time": _TIME,
    **dict.fromkeys(("approved", "identity", "explored", *PARTS, "not_read"), TABLE),
}
_VALUE = Kind((int, Decimal, str), "a number, or a text in quotes")
_KEYS = {"name": TEXT, "value": _VALUE, "unit": TEXT, "raw": RAW, "common": TEXT}
_APPROVED = {"by": TEXT, "why": TEXT, "time": _TIME}
_EXPLORED = dict.fromkeys(("asked", "answered", "known"), WHOLE)
_UNKNOWN = "# The model does not know these: as the telegram carried them, never restored."
_MOST_DIGITS = 50
"""Limit of digits and exponent; no drive has longer numbers.

Floats of 32 bits range from 1E-45 to 3E38. Without a limit, a number with millions of digits would block the program.
"""


def text_of(known: ParameterSet) -> str:
    """Return a parameter set as the text of its file; equal sets give equal texts."""
    return "\n".join([_HEAD, *_lines(known), ""])


def entries_text(known: ParameterSet, part: Part = "settings") -> str:
    """Return one part of the text without its comments: equal parameters give equal bytes."""
    return "\n".join(_line(entry) for entry in _ordered(known, part))


def write_set(path: Path, known: ParameterSet) -> None:
    """Write a parameter set atomically; it may replace an older set of the same drive.

    Raises UsageError for any other existing file, and if the path is not writable.
    """
    must_be_free(path, known.drive)
    write_atomically(path, text_of(known))


def must_be_free(path: Path, drive: str) -> None:
    """Raise UsageError if any other file would be lost, FileFormatError if the path is not writable."""
    must_be_writable(path)
    if not path.exists():
        return
    try:
        there = read_set(path)
    except FileFormatError as error:
        raise UsageError(f"{path} exists and is not a parameter set; give another name") from error
    if there.drive != drive:
        raise UsageError(f"{path}: this is the parameter set of {there.drive}, not of {drive}; give another name")
    if there.approved is not None:
        raise UsageError(f"{path}: this is the approved set of {drive}, which only drivecomm baseline accept replaces")


def read_set(path: Path) -> ParameterSet:
    """Read a parameter set. Raises FileFormatError with the file, the line, the key, and the fault."""
    return _set_in(read_toml(path, "a parameter set", parse_float=Decimal))


def _lines(known: ParameterSet) -> Iterator[str]:
    yield f"format = {_FORMAT}"
    for key in ("protocol", "drive", "model", "firmware"):
        if text := getattr(known, key):
            yield toml_line(key, text)
    if known.time is not None:
        yield _stamp(known.time)
    if known.approved is not None:
        yield from ("", "[approved]", toml_line("by", known.approved.by))
        if known.approved.why:
            yield toml_line("why", known.approved.why)
        yield _stamp(known.approved.time)
    yield from _texts("identity", known.identity, list(known.identity))
    if known.explored is not None:
        yield from ("", "[explored]", *(f"{key} = {getattr(known.explored, key)}" for key in _EXPLORED))
    for part in PARTS:
        if entries := _ordered(known, part):
            head = (_UNKNOWN, f"[{part}]") if part == "unknown" else (f"[{part}]",)
            yield from ("", *head, *(_line(entry) + _comment(entry) for entry in entries))
    yield from _texts("not_read", known.not_read, in_order(known.not_read))


def _stamp(time: datetime) -> str:
    return f"time = {time.astimezone(UTC).strftime('%Y-%m-%dT%H:%M:%SZ')}"


def _ordered(known: ParameterSet, part: Part) -> list[ParameterEntry]:
    return [known.entries[address] for address in in_order(entry.address for entry in known.of([part]))]


def _texts(table: str, texts: Mapping[str, str], order: list[str]) -> Iterator[str]:
    if texts:
        yield from ("", f"[{table}]", *(f"{toml_value(key)} = {toml_value(texts[key])}" for key in order))


def _line(entry: ParameterEntry) -> str:
    fields = {
        "name": entry.name,
        "value": entry.value,
        "unit": entry.unit,
        "raw": entry.raw,
        "common": entry.common,
    }
    told = {key: value for key, value in fields.items() if key == "value" or value not in ("", None)}
    return f"{toml_value(entry.address)} = {toml_value(told)}"


def _comment(entry: ParameterEntry) -> str:
    meaning = " ".join("".join(sign if sign.isprintable() else " " for sign in entry.meaning).split())
    return f" # {meaning}" if meaning else ""


def _set_in(top: TomlTable) -> ParameterSet:
    if top.content.get("format") != _FORMAT:
        raise top.error(f"a parameter set begins with format = {_FORMAT}", "format")
    given = top.take(_TOP, "protocol", "drive", "model")
    for key in ("protocol", "drive", "model"):
        if not given[key]:
            raise top.error(f"{key} is empty; it says where the parameters are from", key)
    entries: dict[str, ParameterEntry] = {}
    for part in PARTS:
        table = top.table(part)
        for address in table.content:
            if address in entries:
                raise table.error(f"{address} is also listed under [{entries[address].part}]", address)
            entries[address] = _entry(part, address, table)
    return ParameterSet(
        protocol=given["protocol"],
        drive=given["drive"],
        model=given["model"],
        firmware=given.get("firmware", ""),
        time=_time_in(top),
        identity=_texts_in(top.table("identity")),
        entries={address: entries[address] for address in in_order(entries)},
        not_read=_texts_in(top.table("not_read")),
        explored=_explored(top.table("explored")),
        approved=_approved(top.table("approved")),
    )


def _time_in(table: TomlTable) -> datetime | None:
    time: datetime | None = table.content.get("time")
    if time is not None and not time.tzinfo:
        raise table.error(f"invalid time {time}; write it with its zone, as 2026-11-21T19:00:00Z", "time")
    return None if time is None else time.astimezone(UTC)


def _approved(table: TomlTable) -> Approval | None:
    if not table.content:
        return None
    given = table.take(_APPROVED, "by", "time")
    return Approval(**{**given, "time": _time_in(table)})


def _explored(table: TomlTable) -> Explored | None:
    if not table.content:
        return None
    counts = table.take(_EXPLORED, *_EXPLORED)
    if not 0 <= counts["known"] <= counts["answered"] <= counts["asked"]:
        raise table.error("more is known than was answered, or more was answered than was asked for")
    return Explored(**counts)


def _entry(part: Part, address: str, table: TomlTable) -> ParameterEntry:
    inner = table.table(address)
    given = inner.take(_KEYS, "value")
    if not _is_sane(given["value"]) or not _is_sane(given.get("raw", 0)):
        raise inner.error("no drive holds such a number")
    common = given.get("common", "")
    if common and common not in quantities():
        known = did_you_mean(common, quantities()) or "drivecomm models names lists them"
        raise inner.error(f"unknown common name {common!r}; {known}")
    return ParameterEntry(address=address, part=part, **given)


def _texts_in(table: TomlTable) -> dict[str, str]:
    return table.take(dict.fromkeys(table.content, TEXT))


def _is_sane(value: Value) -> bool:
    if isinstance(value, str):
        return True
    number = Decimal(value)
    return number.is_finite() and abs(number.adjusted()) < _MOST_DIGITS and len(number.as_tuple().digits) < _MOST_DIGITS
