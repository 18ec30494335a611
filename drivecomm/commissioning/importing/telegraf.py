"""Sections `[[inputs.modbus]]` of Telegraf, as TOML: fields by register, by request or by metric.

Facts of the form: README of plugins/inputs/modbus of Telegraf; addresses are those of telegrams.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from drivecomm.commissioning.importing.foreign_contents import ForeignContents, ForeignRegister
from drivecomm.commissioning.importing.meanings import (
    F32,
    S16,
    S32,
    U16,
    U32,
    RegisterStorage,
    number_in,
    plain,
    title_and_unit,
    whole_in,
)
from drivecomm.errors import FileFormatError

_TYPES = {
    "UINT16": U16, "INT16": S16, "UINT32": U32, "INT32": S32,
    "FLOAT32-IEEE": F32, "UINT8L": RegisterStorage("", "low"), "UINT8H": RegisterStorage("", "high"),
}  # fmt: skip
_FIXED = {
    ("UFIXED", 1): "u16", ("UFIXED", 2): "u32", ("FIXED", 1): "s16", ("FIXED", 2): "s32", ("FLOAT32", 1): "u16",
    ("FLOAT32", 2): "u32",
}  # fmt: skip
"""Types of scaled integers, by their number of registers; FLOAT32 is an old word for UFIXED in fields by register."""

_TABLES = {"holding_registers": "", "input_registers": "i", "coils": "c", "discrete_inputs": "d"}
_KINDS = {"holding": "", "input": "i", "coil": "c", "discrete": "d"}
_ORDERS = {"ABCD": "high", "CDAB": "low"}
_LINE = {"baud_rate": "baudrate", "data_bits": "bytesize", "parity": "parity", "stop_bits": "stopbits"}
_FIELD = frozenset(("name", "address", "byte_order", "data_type", "type", "scale", "bit", "length", "register"))
_SHOWN_ONLY = frozenset(("measurement", "omit", "output", "tags"))


def telegraf_section(text: str, shown: str) -> ForeignContents | None:
    """Return the registers of the sections, None if there are no sections. Raises FileFormatError."""
    try:
        content = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{shown}: cannot be read as TOML: {error}") from error
    inputs = content.get("inputs")
    sections = inputs.get("modbus") if isinstance(inputs, Mapping) else None
    if sections is None:
        return None
    found = ForeignContents(form="Telegraf Modbus section (TOML)")
    controller: object = None
    for number, (place, section) in enumerate(found.tables("inputs.modbus", sections)):
        controller = controller if number else section.get("controller")
        if section.get("controller") != controller:
            found.leave(
                place, f"controller {section.get('controller')}", "another line; keep it alone in a file to import it"
            )
        else:
            _section(found, place, section, first=not number)
    return found


def _section(found: ForeignContents, place: str, section: Mapping[str, Any], *, first: bool) -> None:
    controller = str(section.get("controller", ""))
    if first:
        found.title = str(section.get("name") or "")
        if not controller.startswith("tcp:"):
            found.take_line(place, {option: section[key] for key, option in _LINE.items() if key in section})
            found.port = controller.removeprefix("file://")
        else:
            found.port = f"modbus-tcp:{controller.removeprefix('tcp:')}"
        if section.get("transmission_mode") in ("ASCII", "ASCIIoverTCP"):
            found.options["framing"] = "ascii"
        if section.get("transmission_mode") in ("RTUoverTCP", "ASCIIoverTCP"):
            found.port = f"socket:{controller.removeprefix('tcp:')}"
    drive = whole_in(section.get("slave_id"))
    for table, kind in _TABLES.items():
        for at, field in found.tables(f"{place}.{table}", section.get(table)):
            _field(found, at, {**field, "register": kind}, drive=drive)
    for style in ("request", "metric"):
        for asking, request in found.tables(f"{place}.{style}", section.get(style)):
            order, asked = request.get("byte_order", "ABCD"), whole_in(request.get("slave_id"))
            for at, field in found.tables(f"{asking}.fields", request.get("fields")):
                read = _KINDS.get(str(field.get("register", request.get("register", "holding"))))
                told = {"byte_order": order, **field, "register": read, "data_type": _by_request(field.get("type"))}
                _field(found, at, told, drive=drive if asked is None else asked)


def _by_request(word: object) -> str:
    return {"FLOAT32": "FLOAT32-IEEE"}.get(str(word or "UINT16"), str(word or "UINT16"))


def _field(found: ForeignContents, place: str, field: Mapping[str, Any], *, drive: int | None) -> None:
    title, unit, _ = title_and_unit(str(field.get("name") or place))
    given = field.get("address")
    addresses = [whole_in(each) for each in given] if isinstance(given, list) else [whole_in(given)]
    first = addresses[0] if addresses else None
    kind = field["register"]
    if first is None or kind is None:
        found.leave(place, title, "names no register")
        return
    if addresses != list(range(first, first + len(addresses))):
        found.leave(place, f"address {given}", "not consecutive registers")
        return
    if kind in ("c", "d"):
        held: RegisterStorage | None = RegisterStorage("")
    else:
        held = _held(field, len(addresses) if isinstance(given, list) else None)
    if held is None:
        what = f"{field.get('data_type')}, {field.get('byte_order', 'no byte_order')}, address {given}"
        found.leave(place, what, "not a type and an order that a model can express")
        return
    scale = number_in(field.get("scale", 1))
    if not scale:
        found.leave(place, f"scale {field['scale']}", "not a factor")
        return
    for key in sorted(field.keys() - _FIELD - _SHOWN_ONLY):
        found.leave(f"{place}.{key}", field[key], "not understood; the register is read all the same")
    found.add(
        ForeignRegister(
            place=place, title=title, kind=kind, number=first, part=held.part, type=held.type, unit=unit,
            factor=plain(scale), word_order=held.order, drive=drive,
        )
    )  # fmt: skip


def _held(field: Mapping[str, Any], registers: int | None) -> RegisterStorage | None:
    word, order = str(field.get("data_type")), str(field.get("byte_order", ""))
    if word == "BIT":
        bit = whole_in(field.get("bit", 0))
        return RegisterStorage("", str(bit)) if bit in range(16) else None
    held = _TYPES.get(word)
    if held is None and registers is not None and (fixed := _FIXED.get((word, registers))):
        held = RegisterStorage(fixed)
    if held is None:
        return None
    wide = held.type.endswith("32")
    if registers is not None and registers != (2 if wide else 1):
        return None
    if not wide:
        return held if order in ("", "AB", "ABCD", "CDAB") else None
    return held._replace(order=_ORDERS[order]) if order in _ORDERS else None
