"""Rules for the consistency of panel settings: with the model's parameters, its watchdog, and each other."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, get_args

from drivecomm.models.quantities import parameter_at
from drivecomm.models.schema import Mistake
from drivecomm.models.setup_sheets import codes_of
from drivecomm.protocol import LinkLoss, Parity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Any

    from drivecomm.protocol import MadeFrom, Model, PanelSetting, ParameterInfo

_FORMAT = r"[78][NEOMS](1|1\.5|2)"
_PLANT_VALUES: Mapping[MadeFrom, str] = {
    "address": r"\d+",
    "baudrate": r"[1-9]\d+",
    "bytesize": r"[78]",
    "parity": "|".join(get_args(Parity)),
    "stopbits": r"1|1\.5|2",
    "format": _FORMAT,
    "line": rf"[1-9]\d+ {_FORMAT}",
    "link_loss": "|".join(get_args(LinkLoss)),
    "watchdog_s": "hold",
}


def broken_setup(rows: Sequence[Mapping[str, Any]], model: Model) -> Iterator[Mistake]:
    """Yield the mistakes in the panel settings of a file. rows: as written; they are those of the model."""
    seen: set[tuple[str, str]] = set()
    for number, setting in enumerate(model.setup if rows else ()):
        for key, text in _wrong(setting, model):
            yield Mistake(table="setup", number=number, key=key, text=text)
        if (place := (setting.parameter, setting.when)) in seen:
            yield Mistake(table="setup", number=number, key="parameter", text=f"{place[0]} is listed twice")
        seen.add(place)


def _wrong(setting: PanelSetting, model: Model) -> Iterator[tuple[str, str]]:
    made_from, codes = setting.made_from, codes_of(setting, model)
    if not setting.source.strip():
        yield "", "its source is missing; name the manual and the page under source"
    if setting.hexadecimal and made_from != "address":
        yield "hexadecimal", "is for an address"
    if made_from is None and codes:
        yield "codes", "a value that is always the same has no codes; write made_from"
    pattern = _PLANT_VALUES.get(made_from, "") if made_from else ""
    for said in codes if made_from else ():
        if not re.fullmatch(pattern, said):
            yield "codes", f"{said!r} cannot be the {made_from} of a plant"
    if made_from == "link_loss" and not codes:
        yield "codes", "neither these nor a watchdog define the settings for hold, ramp, coast or trip"
    if not setting.address:
        return
    info = parameter_at(setting.address, model)
    if info is None or "r" not in info.access:
        yield "address", f"the model has no parameter {setting.address!r} that can be read"
        return
    written = [setting.value, *setting.also] if made_from is None else list(codes.values())
    for value in written:
        if not _is_there(value, info):
            yield "value" if made_from is None else "codes", f"parameter {info.address} takes no {value!r}"


def _is_there(value: str, info: ParameterInfo) -> bool:
    """Return whether a parameter can show a value of the panel: as one of its texts, or as its number."""
    if value in info.values.values():
        return True
    return value.isdecimal() and (not info.values or int(value) in info.values)
