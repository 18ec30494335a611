"""Register lists as CSV: columns by their headings, delimiter and encoding detected, one register per row."""

from __future__ import annotations

import csv
import io
import re
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.commissioning.importing.addresses import Base, CountedRegister, counting_of
from drivecomm.commissioning.importing.foreign_contents import ForeignContents, ForeignRegister
from drivecomm.commissioning.importing.headings import NEEDED, columns_in, further_addresses
from drivecomm.commissioning.importing.meanings import (
    RegisterStorage,
    held_as,
    number_in,
    plain,
    ratio,
    texts_in,
    title_and_unit,
    unit_in,
    whole_in,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_ENCODINGS = ("utf-8", "cp1252", "cp1251", "gb18030")
"""Encodings to try; the earlier one wins if the headings are the same in two of them."""

_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_DELIMITERS = {";": "semicolon", "\t": "tab", ",": "comma", "|": "bar"}
_HEADING_WITHIN = 30
"""Number of rows searched for the heading line; lists have a title and remarks above it."""

_FUNCTIONS = {1: "c", 2: "d", 3: "", 4: "i", 5: "c", 6: "", 15: "c", 16: ""}
_WRITES = frozenset((5, 6, 15, 16))
_KINDS = (
    (re.compile(r"holding|halte|\b4x|\bhr\b|^h$|удержан|хранен|保持"), ""),
    (re.compile(r"coil|\b0x$|spule|катуш|线圈"), "c"),
    (re.compile(r"discrete|input (?:status|contact|bit)|\b1x|\bdi\b|дискрет|离散"), "d"),
    (re.compile(r"input|eingang|\b3x|\bir\b|^i$|входн|输入"), "i"),
)
"""Words for the kinds of registers; the first match wins."""

_NUMBERS = re.compile(r"(?<![\dx])(0x[0-9a-f]{1,2}|[0-9]{1,2})(?=h?(?![\dx]))", re.IGNORECASE)
_NO_READ = ("w", "wo", "write", "write only", "write-only", "schreiben", "nur schreiben", "запись", "ecriture", "只写")
_ORDERS = {
    "high": ("abcd", "big", "big endian", "big-endian", "be", "high first", "msw first", "msw", "high", "hl", "0123"),
    "low": ("cdab", "little", "little endian", "little-endian", "low first", "lsw first", "lsw", "low", "lh", "swapped",
            "word swap", "2301"),
}  # fmt: skip


class _Sheet(NamedTuple):
    """Register list as rows and layout: the rows from the heading on, each with the number of its last line."""

    rows: list[tuple[int, list[str]]]
    columns: dict[str, int]
    delimiter: str
    encoding: str


def register_list(data: bytes, base: Base | None) -> ForeignContents | None:
    """Return the registers of a list, None if no line has recognisable column headings.

    base: numbering of the registers, if the user states it.
    """
    sheet = _opened(data)
    if sheet is None:
        return None
    heading, rows = sheet.rows[0][1], sheet.rows[1:]
    found = ForeignContents(form=f"register list (CSV, {_DELIMITERS[sheet.delimiter]}, {sheet.encoding})")
    for number, cell in enumerate(heading):
        if cell.strip() and number not in sheet.columns.values():
            other = number in further_addresses(heading, sheet.columns)
            reason = (
                "another count of the same registers, which is not used"
                if other
                else "a column that is not understood or used"
            )
            found.leave(f"line {sheet.rows[0][0]}", cell.strip(), reason)
    _functions_as_type(sheet.columns, rows)
    found.columns = {column: heading[number].strip() for column, number in sheet.columns.items()}
    addresses = [_cell(row, sheet.columns, "address") for _, row in rows]
    counting = counting_of(addresses, heading[sheet.columns["address"]], base)
    found.assumptions.append(_counted_as(counting.base, certain=counting.certain, hexadecimal=counting.hex))
    if "type" not in sheet.columns:
        found.assume("every register is an unsigned number of 16 bits, because no column gives the type")
    for line, row in rows:
        if not any(cell.strip() for cell in row):
            continue
        place = f"line {line}"
        printed = _cell(row, sheet.columns, "address")
        counted = counting.of(printed)
        if counted is None:
            filled = " | ".join(cell.strip() for cell in row if cell.strip())
            found.leave(place, filled[:60], f"{printed!r} names no register as this list counts them" if printed else
                        "names no register")  # fmt: skip
            continue
        _row(found, place, {name: _cell(row, sheet.columns, name) for name in sheet.columns}, counted)
    return found


def _functions_as_type(columns: dict[str, int], rows: list[tuple[int, list[str]]]) -> None:
    """Treat a column `type` as the function column if it has holding, input or the like in every row."""
    types = {text for _, row in rows if (text := _cell(row, columns, "type"))}
    if "function" not in columns and types and all(_named_kind(each) is not None for each in types):
        columns["function"] = columns.pop("type")


def _row(found: ForeignContents, place: str, cells: Mapping[str, str], counted: CountedRegister) -> None:
    printed = cells["address"]
    kind = _kind(found, place, cells.get("function", ""), counted)
    if kind is None:
        return
    title, unit, step = title_and_unit(" ".join(cells["name"].split()))
    if word := cells.get("unit", ""):
        known = unit_in(word)
        if known is None:
            found.leave(place, f"unit {word}", "not a known unit, so the value has none")
        else:
            unit, step = known
    factor = _factor(found, place, cells, step)
    held = _held(found, place, cells, counted, kind)
    if factor is None or held is None:
        return
    values = texts_in(cells["values"]) if cells.get("values") else {}
    if cells.get("values") and not values:
        found.leave(place, f"values {cells['values'][:40]}", "not a list such as 0: stop; 1: run")
    access = cells.get("access", "").casefold().strip()
    if "w" in access and access not in _NO_READ:
        found.assume("registers that the list lets one write are only read")
    found.add(
        ForeignRegister(
            place=place, title=title or f"register {printed}", kind=kind, number=counted.number, part=held.part,
            type=held.type, unit=unit, factor=factor, values=values, word_order=held.order,
            written=access in _NO_READ or (_function(cells.get("function", "")) or ("", False))[1], counted=printed,
        )
    )  # fmt: skip


def _kind(found: ForeignContents, place: str, function: str, counted: CountedRegister) -> str | None:
    """Return the kind of register by its function or its number; None if the two disagree."""
    if not function.strip():
        if counted.kind is None:
            found.assume("registers without a function are holding registers, which function 03 reads")
        return counted.kind or ""
    named = _function(function)
    if named is None:
        found.leave(place, f"function {function}", "not a function that reads registers or coils")
        return None
    if counted.kind is not None and counted.kind != named[0]:
        found.leave(place, f"function {function}", f"does not read what {counted.number + 1} is by Modicon's count")
        return None
    return named[0]


def _function(text: str) -> tuple[str, bool] | None:
    """Return the kind of register meant by `FC03`, `3/16` or `Holding`, and whether the function only writes."""
    if (named := _named_kind(text)) is not None:
        return named, False
    numbers = [int(each, 16 if each[:2] in ("0x", "0X") else 10) for each in _NUMBERS.findall(text)]
    kinds = {_FUNCTIONS.get(number) for number in numbers}
    kind_of_all = kinds.pop() if len(kinds) == 1 else None
    return None if kind_of_all is None else (kind_of_all, set(numbers) <= _WRITES)


def _named_kind(text: str) -> str | None:
    return next((kind for pattern, kind in _KINDS if pattern.search(text.casefold().strip())), None)


def _factor(found: ForeignContents, place: str, cells: Mapping[str, str], step: Decimal) -> Decimal | None:
    """Return the factor of a raw value; record the row as not imported and return None if the factor is uncertain."""
    if (offset := cells.get("offset", "")) and number_in(offset) != 0:
        found.leave(place, f"offset {offset}", "a model has no offset, and without it the value would be wrong")
        return None
    given: dict[str, Decimal | None] = {}
    for column in ("factor", "scale", "divisor", "decimals"):
        if not (text := cells.get(column, "").strip()) or text in ("-", "--"):
            continue
        if column == "divisor":
            number = number_in(text)
            given[column] = ratio(1, number) if number is not None else None
        elif column == "decimals":
            places = whole_in(text)
            given[column] = (
                plain(Decimal(1).scaleb(-places))
                if places is not None and 0 <= places <= 9
                else _factor_in(text, is_scale=True)
            )
        else:
            given[column] = _factor_in(text, is_scale=column == "scale")
        if given[column] is None:
            reason = (
                "could mean times or divided by" if column == "scale" and number_in(text) else "not an exact factor"
            )
            found.leave(place, f"{column} {text}", f"{reason}; call the column factor or divisor in the file")
            return None
    if step != 1:
        given["unit"] = step
    numbers = {number for number in given.values() if number is not None}
    if len(numbers) > 1:
        says = ", ".join(f"{column} {number}" for column, number in given.items())
        found.leave(place, says, "the columns disagree about the factor")
        return None
    return numbers.pop() if numbers else Decimal(1)


def _factor_in(text: str, *, is_scale: bool) -> Decimal | None:
    word = text.casefold().replace("×", "*").replace("÷", "/").strip()
    over, slash, under = word.partition("/") if "/" in word else word.partition(":")
    if slash:
        above, below = number_in(over.lstrip("*x ") or "1"), number_in(under)
        return ratio(above, below) if above and below else None
    number = number_in(word.lstrip("*x "))
    if number is None:
        known = unit_in(word)
        number = known[1] if known else None
    if not number or ((is_scale or word.startswith("x")) and abs(number) > 1):
        return None
    return plain(number)


def _held(
    found: ForeignContents, place: str, cells: Mapping[str, str], counted: CountedRegister, kind: str
) -> RegisterStorage | None:
    """Return the storage of a value; record the row as not imported and return None if the storage is uncertain."""
    bit = cells.get("bit", "").strip() or counted.bit
    if bit:
        if bit.isdecimal() and int(bit) <= 15 and kind in ("", "i"):
            return RegisterStorage("", str(int(bit)))
        found.leave(place, f"bit {bit}", "not a bit from 0 to 15 of a register")
        return None
    if kind in ("c", "d"):
        return RegisterStorage("")
    text, count = cells.get("type", "").strip(), cells.get("count", "").strip()
    words = whole_in(count) if count else None
    held = held_as(text) if text else RegisterStorage("u16")
    if held is None and text.casefold() in ("int", "integer") and words in (None, 1):
        found.assume(f"{text} is a signed number of 16 bits, as in IEC 61131-3")
        held = RegisterStorage("s16")
    if held is None:
        found.leave(place, f"type {text}", "not a type whose width and sign are certain")
        return None
    if words is not None and words != (2 if held.type.endswith("32") else 1):
        says = f"type {text}, count {count}" if text else f"count {count}"
        found.leave(place, says, "the type of a value in this number of registers is not certain")
        return None
    if order := " ".join(cells.get("order", "").casefold().split()):
        known = next((each for each, names in _ORDERS.items() if order in names), None)
        if known is None and held.type.endswith("32"):
            found.leave(place, f"word order {order}", "not an order of two words that a model can express")
            return None
        return held._replace(order=known or "") if held.type.endswith("32") else held
    return held


def _counted_as(base: Base, *, certain: bool, hexadecimal: bool) -> str:
    told = {
        "0": "registers are counted from 0, as in a telegram",
        "1": "registers are counted from 1: 1 is register 0 in a telegram",
        "modicon": "registers are counted as Modicon did: 40001 is holding register 0, 30001 input register 0",
    }[base]
    digits = " and written in hexadecimal" if hexadecimal else ""
    return f"{told}{digits}{'' if certain else ' (assumed; --register-base says otherwise)'}"


def _cell(row: list[str], columns: Mapping[str, int], name: str) -> str:
    place = columns.get(name, len(row))
    return row[place].strip() if place < len(row) else ""


def _opened(data: bytes) -> _Sheet | None:
    """Return the list, read with the encoding and delimiter that give the most recognised columns."""
    best: _Sheet | None = None
    for encoding, text in _decoded(data):
        for delimiter in _DELIMITERS:
            sheet = _sheet(text, delimiter, encoding)
            if sheet is not None and (best is None or len(sheet.columns) > len(best.columns)):
                best = sheet
    return best


def _sheet(text: str, delimiter: str, encoding: str) -> _Sheet | None:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        rows = [(reader.line_num, row) for row in reader]
    except csv.Error:
        return None
    for start, (_, row) in enumerate(rows[:_HEADING_WITHIN]):
        columns = columns_in(row)
        if all(name in columns for name in NEEDED):
            return _Sheet(rows[start:], columns, delimiter, encoding)
    return None


def _decoded(data: bytes) -> Iterator[tuple[str, str]]:
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            yield encoding, data.decode(encoding, errors="replace")
            return
    for encoding in _ENCODINGS:
        try:
            yield encoding, data.decode(encoding)
        except UnicodeDecodeError:
            continue
