"""Device templates of wb-mqtt-serial (Wiren Board): registers as channels and parameters of a device, as JSON.

Facts of the form: wb-mqtt-serial README and its templates, such as that of the Danfoss FC 51.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from decimal import Decimal
from typing import TYPE_CHECKING, Any

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
from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Iterator

_KINDS = {"holding": "", "holding_single": "", "holding_multi": "", "input": "i", "coil": "c", "discrete": "d"}
_FORMATS = {
    "u16": U16, "s16": S16, "u32": U32, "s32": S32, "float": F32,
    "u8": RegisterStorage("", "low"), "string": RegisterStorage("string"),
}  # fmt: skip
_UNITS = {"voltage": "V", "temperature": "degC", "power": "W", "power_consumption": "kWh", "current": "A"}
"""Units implied by the type of a channel."""

_SHOWN_ONLY = frozenset(
    (
        *(
            "group",
            "enabled",
            "title",
            "description",
            "order",
            "sporadic",
            "semi-sporadic",
            "read_period_ms",
            "round_to",
        ),
        *(
            "read_rate_limit_ms",
            "poll_interval",
            "precision",
            "min",
            "max",
            "default",
            "required",
            "on_value",
            "off_value",
        ),
        *("id", "enum", "enum_titles", "units", "unsupported_value", "readonly", "write_address"),
    )
)
"""Keys that serve only display, polling or writing there, and keys that are read in other places of this module."""

_CARRIED = frozenset(
    ("name", "reg_type", "address", "type", "format", "scale", "offset", "word_order", "string_data_size")
)


def wirenboard_template(text: str, shown: str) -> ForeignContents | None:
    """Return the registers in a template, None if the text is JSON of another kind. Raises FileFormatError."""
    try:
        content = json.loads(text, parse_float=Decimal)
    except ValueError as error:
        raise FileFormatError(f"{shown}: cannot be read as JSON: {error}") from error
    device = content.get("device") if isinstance(content, Mapping) else None
    if not isinstance(device, Mapping):
        return None
    found = ForeignContents(form="wb-mqtt-serial device template (JSON)", title=str(device.get("name", "")))
    if device.get("protocol", "modbus") not in ("modbus", "modbus_io"):
        found.leave("device.protocol", device["protocol"], "not Modbus, so the file has no registers")
        return found
    for key in ("setup", "subdevices"):
        for place, entry in found.tables(f"device.{key}", device.get(key)):
            reason = "a write when the program starts, which is never sent from here" if key == "setup" else "not read"
            found.leave(place, _named(entry), reason)
    words = _words(device)
    strange: dict[str, list[str]] = {}
    for place, entry in _entries(found, device):
        _channel(found, place, entry, words, strange)
    for key, places in sorted(strange.items()):
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        found.leave(f"{places[0]}.{key}{more}", None, "not understood; the register is read all the same")
    return found


def _entries(found: ForeignContents, device: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield from found.tables("device.channels", device.get("channels"))
    parameters = device.get("parameters")
    if isinstance(parameters, Mapping):
        for name, entry in parameters.items():
            if isinstance(entry, Mapping):
                yield f"device.parameters.{name}", {"name": name, **entry}
    else:
        yield from found.tables("device.parameters", parameters)


def _words(device: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the English titles, by the keys that the template uses for them."""
    translations = device.get("translations")
    words = translations.get("en") if isinstance(translations, Mapping) else None
    return words if isinstance(words, Mapping) else {}


def _channel(
    found: ForeignContents,
    place: str,
    entry: Mapping[str, Any],
    words: Mapping[str, Any],
    strange: dict[str, list[str]],
) -> None:
    """Add the register of a channel or parameter.

    words: English titles, by the keys that the template uses for them. strange: collects the places of unknown keys, by
    key.
    """
    if "address" not in entry or "reg_type" not in entry:
        found.leave(place, _named(entry), "has no register of its own")
        return
    called = str(entry.get("title") or entry.get("name") or entry.get("id") or place)
    title, unit, _ = title_and_unit(str(words.get(called, called)))
    kind = _KINDS.get(str(entry["reg_type"]))
    if kind is None:
        found.leave(place, f"reg_type {entry['reg_type']}", "not holding, input, coil or discrete")
        return
    format_ = str(entry.get("format", "u16"))
    number, held = _place(str(entry["address"]), _FORMATS.get(format_), kind)
    if number is None:
        found.leave(place, f"address {entry['address']}", "not a register, or not one bit or byte of it")
        return
    if held is None:
        found.leave(place, f"format {format_}", "not a type that a model can express")
        return
    characters = 2 * (whole_in(entry.get("string_data_size", 0)) or 0)
    if held.type == "string" and not characters:
        found.leave(place, f"format {format_}", "the length of the text is not given")
        return
    scale, offset = number_in(entry.get("scale", 1)), number_in(entry.get("offset", 0))
    if not scale or offset is None or offset:
        what = f"scale {entry.get('scale', 1)}, offset {entry.get('offset', 0)}"
        found.leave(place, what, "a model has a factor and no offset, and without it the value would be wrong")
        return
    order = {"big_endian": "high", "little_endian": "low"}.get(str(entry.get("word_order", "big_endian")))
    if order is None:
        found.leave(place, f"word_order {entry['word_order']}", "neither big_endian nor little_endian")
        return
    for key in sorted(map(str, entry.keys() - _SHOWN_ONLY - _CARRIED)):
        strange.setdefault(key, []).append(place)
    if not entry.get("readonly") and kind in ("", "c"):
        found.assume("channels that the program also writes are only read")
    found.add(
        ForeignRegister(
            place=place, title=title, kind=kind, number=number, part=held.part, type=held.type,
            unit=_unit(found, place, entry) or unit, factor=plain(scale), values=_texts(found, place, entry),
            word_order=order if held.type.endswith("32") else "", characters=characters,
        )
    )  # fmt: skip


def _place(address: str, held: RegisterStorage | None, kind: str) -> tuple[int | None, RegisterStorage | None]:
    """Return the register of `16129` or `50199:11:1` (first bit, width), and the storage of its value."""
    start, *bits = address.split(":")
    number = whole_in(start)
    if kind in ("c", "d"):
        return (None if bits else number), RegisterStorage("")
    if not bits:
        return number, held
    first, width = whole_in(bits[0]), whole_in(bits[1]) if len(bits) == 2 else None
    if width == 1 and first in range(16):
        return number, RegisterStorage("", str(first))
    part = {(0, 8): "low", (8, 8): "high"}.get((first, width)) if first is not None and width is not None else None
    return (number, RegisterStorage("", part)) if part else (None, held)


def _unit(found: ForeignContents, place: str, entry: Mapping[str, Any]) -> str:
    if "units" not in entry:
        return _UNITS.get(str(entry.get("type")), "")
    known = unit_in(str(entry["units"]))
    if known is None:
        found.leave(f"{place}.units", entry["units"], "not a known unit, so the value has none")
    return known[0] if known else ""


def _texts(found: ForeignContents, place: str, entry: Mapping[str, Any]) -> dict[int, str]:
    codes, titles = (each if isinstance(each, list) else [] for each in (entry.get("enum"), entry.get("enum_titles")))
    values = {}
    for code, title in zip(codes, titles, strict=False):
        text = title.get("en", next(iter(title.values()), "")) if isinstance(title, Mapping) else title
        if (number := whole_in(code)) is not None:
            values[number] = str(text)
    if len(values) < len(codes):
        found.leave(f"{place}.enum", codes, "does not have a title and a whole number for each value")
    return values


def _named(entry: Mapping[str, Any]) -> str:
    return str(entry.get("title") or entry.get("name") or "")
