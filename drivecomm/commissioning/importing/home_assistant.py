"""Section `modbus:` of Home Assistant, as YAML.

Facts of the form: the page of the integration Modbus at home-assistant.io; addresses are those of telegrams.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    unit_in,
    whole_in,
)

_TYPES = {
    "uint16": U16, "int16": S16, "uint32": U32, "int32": S32, "float32": F32,
    "string": RegisterStorage("string"),
}  # fmt: skip
_OLD_TYPES = {
    ("int", 1): "int16",
    ("int", 2): "int32",
    ("uint", 1): "uint16",
    ("uint", 2): "uint32",
    ("float", 2): "float32",
}
"""Types of versions before 2022, which had a separate number of registers."""

_KINDS = {"holding": "", "input": "i", "coil": "c", "discrete_input": "d"}
_WRITERS = ("switches", "lights", "fans", "covers", "climates")
_SHOWN_ONLY = frozenset(
    (
        *("name", "unique_id", "device_class", "state_class", "scan_interval", "precision", "lazy_error_count", "icon"),
        *("slave", "device_address", "unit", "hub", "count", "address", "input_type", "data_type", "swap", "scale"),
        *("offset", "unit_of_measurement", "register", "register_type"),
    )
)
_SCHEMES = {"tcp": "modbus-tcp", "rtuovertcp": "socket"}
_LINE = ("baudrate", "bytesize", "parity", "stopbits")


def home_assistant_section(content: Any) -> ForeignContents | None:
    """Return the registers of the section, None if there is no section; a bare list of hubs is accepted as well."""
    hubs = content
    if isinstance(content, Mapping):
        # A package nests its section below the package name.
        packages = (each["modbus"] for each in content.values() if isinstance(each, Mapping) and "modbus" in each)
        hubs = content.get("modbus", next(packages, None))
    if isinstance(hubs, Mapping):
        hubs = [hubs]
    if not isinstance(hubs, Sequence) or isinstance(hubs, str) or not any(_is_hub(hub) for hub in hubs):
        return None
    found = ForeignContents(form="Home Assistant Modbus section (YAML)")
    for number, hub in enumerate(hubs):
        if _is_hub(hub):
            _hub(found, f"modbus[{number}]", hub, first=not number)
        else:
            found.leave(f"modbus[{number}]", None, "not a hub with sensors")
    return found


def _is_hub(hub: object) -> bool:
    keys = ("sensors", "binary_sensors", *_WRITERS)
    return isinstance(hub, Mapping) and any(isinstance(hub.get(key), list) for key in keys)


def _hub(found: ForeignContents, place: str, hub: Mapping[str, Any], *, first: bool) -> None:
    if first:
        found.title = str(hub.get("name") or "")
        if hub.get("type") == "serial":
            found.take_line(place, {key: hub[key] for key in _LINE if key in hub})
        found.port = str(hub.get("port", "")) if hub.get("type") == "serial" else ""
        if (scheme := _SCHEMES.get(str(hub.get("type")))) is not None:
            found.port = f"{scheme}://{hub.get('host', 'HOST')}:{hub.get('port', 502)}"
        if hub.get("method") == "ascii":
            found.options["framing"] = "ascii"
    else:
        found.leave(place, hub.get("name"), "another line; keep it alone in a file to import it")
        return
    for key, entries in hub.items():
        if not isinstance(entries, list):
            continue
        for at, entry in found.tables(f"{place}.{key}", entries):
            if key in ("sensors", "binary_sensors"):
                _sensor(found, at, entry, bit=key == "binary_sensors")
            elif key in _WRITERS:
                _writer(found, at, entry)
            else:
                found.leave(at, entry.get("name"), f"{key} are not understood")


def _sensor(found: ForeignContents, place: str, entry: Mapping[str, Any], *, bit: bool) -> None:
    title, unit, _ = title_and_unit(str(entry.get("name") or place))
    number = whole_in(entry.get("address", entry.get("register")))
    kind = _KINDS.get(str(entry.get("input_type", entry.get("register_type", "coil" if bit else "holding"))))
    held = _held(entry, bit=bit, kind=kind or "")
    scale, offset = number_in(entry.get("scale", 1)), number_in(entry.get("offset", 0))
    swap = str(entry.get("swap") or "none").casefold()
    if number is None or kind is None:
        found.leave(place, title, "names no register, or an input_type that is not understood")
    elif held is None:
        count = f", count {entry['count']}" if "count" in entry else ""
        found.leave(place, f"data_type {entry.get('data_type', 'int16')}{count}", "not a type that a model can express")
    elif not scale or offset is None or offset:
        what = f"scale {entry.get('scale', 1)}, offset {entry.get('offset', 0)}"
        found.leave(place, what, "a model has a factor and no offset, and without it the value would be wrong")
    elif swap not in ("none", "false", "word") or (swap == "word" and not held.type.endswith("32")):
        found.leave(place, f"swap {swap}", "a model gives the order of two words, not of bytes")
    else:
        for key in sorted(entry.keys() - _SHOWN_ONLY, key=str):
            found.leave(f"{place}.{key}", entry[key], "not understood; the register is read all the same")
        if word := entry.get("unit_of_measurement"):
            known = unit_in(str(word))
            if known is None:
                found.leave(f"{place}.unit_of_measurement", word, "not a known unit, so the value has none")
            unit = known[0] if known else ""
        order = ("low" if swap == "word" else "high") if held.type.endswith("32") else ""
        found.add(
            ForeignRegister(
                place=place, title=title, kind=kind, number=number, part=held.part, type=held.type, unit=unit,
                factor=plain(scale), word_order=order, drive=_drive(entry),
                characters=2 * (whole_in(entry.get("count", 0)) or 0) if held.type == "string" else 0,
            )
        )  # fmt: skip


def _held(entry: Mapping[str, Any], *, bit: bool, kind: str) -> RegisterStorage | None:
    if kind in ("c", "d"):
        return RegisterStorage("")
    if bit:
        # A binary sensor shows the lowest bit of the register.
        return RegisterStorage("", "0")
    count, word = whole_in(entry.get("count", 1)), str(entry.get("data_type", "int16")).casefold()
    held = _TYPES.get(_OLD_TYPES.get((word, count or 1), word))
    if held is None or (held.type == "string" and not count):
        return None
    wanted = count if held.type == "string" else 2 if held.type.endswith("32") else 1
    return held if "count" not in entry or count == wanted else None


def _writer(found: ForeignContents, place: str, entry: Mapping[str, Any]) -> None:
    number, kind = whole_in(entry.get("address")), {"coil": "c", "coils": "c"}.get(str(entry.get("write_type")), "")
    if number is not None and "write_type" in entry:
        found.add(
            ForeignRegister(
                place=place, title=str(entry.get("name") or place), kind=kind, number=number, drive=_drive(entry),
                type="" if kind else "u16", written=True,
            )
        )  # fmt: skip
    found.leave(place, entry.get("name"), "writes to the drive, which is never done from here")


def _drive(entry: Mapping[str, Any]) -> int | None:
    return next((whole_in(entry[key]) for key in ("device_address", "slave", "unit") if key in entry), None)
