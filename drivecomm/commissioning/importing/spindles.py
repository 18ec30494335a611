"""Spindle drives in configurations of machine tools: vfdmod of LinuxCNC (ini) and grblHAL (a list of its settings).

Facts of the forms: configs/blank-config.ini of vfdmod; settings 460 to 471 of the VFD plugin of grblHAL.
"""

from __future__ import annotations

import configparser
import re
from typing import TYPE_CHECKING

from drivecomm.commissioning.importing.foreign_contents import ForeignContents, ForeignRegister
from drivecomm.commissioning.importing.meanings import ratio, title_and_unit, whole_in
from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping

_LINE = {"baudrate": "baudrate", "databits": "bytesize", "parity": "parity", "stopbits": "stopbits"}
_OTHERS = frozenset(("common", "rs485", "control", "spindlerpmin", "spindlerpmout"))
_SETTING = re.compile(r"^\s*\$(\d+)\s*=\s*(\S+)", re.MULTILINE)
_VFD_SETTINGS = range(460, 480)


def vfdmod_configuration(text: str, shown: str) -> ForeignContents | None:
    """Return the registers in an ini file of vfdmod, None for another ini file. Raises FileFormatError."""
    ini = configparser.ConfigParser(interpolation=None, strict=False, allow_no_value=True)
    try:
        ini.read_string(text)
    except configparser.Error as error:
        raise FileFormatError(f"{shown}: cannot be read as an ini file: {' '.join(str(error).split())}") from error
    groups = {name.casefold(): name for name in ini.sections()}
    if "spindlerpmout" not in groups:
        return None
    found = ForeignContents(form="vfdmod configuration (ini)")
    drive = _line(found, ini[groups["rs485"]]) if "rs485" in groups else None
    if "common" in groups:
        found.title = ini[groups["common"]].get("componentname") or ""
    for key in ("control", "spindlerpmin"):
        if key in groups:
            _commands(found, groups[key], ini[groups[key]])
    out = groups["spindlerpmout"]
    _reading(found, out, ini[out], title="spindle speed", unit="rpm", drive=drive)
    for key, name in groups.items():
        if key not in _OTHERS:
            title, unit, _ = title_and_unit(ini[name].get("pinname") or name)
            _reading(found, name, ini[name], title=title, unit=unit, drive=drive)
    return found


def _line(found: ForeignContents, group: Mapping[str, str | None]) -> int | None:
    """Import the line settings; return the address of the drive."""
    found.take_line("[RS485]", {option: group[key] for key, option in _LINE.items() if group.get(key)})
    found.port = group.get("serialdevice") or ""
    return whole_in(group.get("slaveaddress") or "")


def _commands(found: ForeignContents, name: str, group: Mapping[str, str | None]) -> None:
    for key, value in group.items():
        if key == "address" and (number := whole_in(value)) is not None:
            title = "command register" if name.casefold() == "control" else "speed command register"
            found.add(ForeignRegister(place=f"[{name}] Address", title=title, number=number, written=True))
            found.leave(f"[{name}]", f"Address {value}", "commands the drive, so it is named and never written")
        elif key.endswith("coil") and (number := whole_in(value)) is not None:
            found.add(
                ForeignRegister(place=f"[{name}] {key}", title=key, kind="c", number=number, type="", written=True)
            )
            found.leave(f"[{name}] {key}", value, "commands the drive, so it is named and never written")
        elif key.endswith("value"):
            found.leave(f"[{name}] {key}", value, "a command, which is never sent from here")


def _reading(
    found: ForeignContents, name: str, group: Mapping[str, str | None], *, title: str, unit: str, drive: int | None
) -> None:
    place, function = f"[{name}]", whole_in(group.get("functioncode") or "3")
    number = whole_in(group.get("address") or "")
    factor = ratio(whole_in(group.get("multiplier") or "1") or 0, whole_in(group.get("divider") or "1") or 0)
    kind = {1: "c", 3: ""}.get(function or 0)
    pin = (group.get("pintype") or "float").casefold()
    if number is None:
        found.leave(place, f"Address {group.get('address')}", "not a register")
    elif kind is None:
        found.leave(place, f"FunctionCode {group.get('functioncode')}", "does not read registers or coils")
    elif factor is None:
        scale = f"Multiplier {group.get('multiplier')}, Divider {group.get('divider')}"
        found.leave(place, scale, "not a factor that a decimal number expresses exactly")
    elif pin == "bit" and not kind:
        found.leave(place, "PinType bit", "which bit of the register is not understood")
    else:
        if pin == "s32":
            found.assume("registers hold unsigned numbers of 16 bits: PinType says how HAL counts, not the sign there")
        found.add(
            ForeignRegister(
                place=place, title=title, kind=kind, number=number, type="" if kind else "u16", unit=unit,
                factor=factor, drive=drive,
            )
        )  # fmt: skip


def grblhal_settings(text: str) -> ForeignContents | None:
    """Return the registers in the grblHAL settings of a generic VFD, None if the text has no such settings.

    The settings have the form that `$$` prints: 462 and 463 are the registers of the commands, 464 is the one with the
    speed, 470 and 471 its multiplier and divider.
    """
    given = {int(key): value for key, value in _SETTING.findall(text) if int(key) in _VFD_SETTINGS}
    if not given:
        return None
    found = ForeignContents(form="grblHAL settings of a Modbus spindle", title="spindle drive")
    for setting, title in ((462, "command register"), (463, "frequency command register")):
        if (number := whole_in(given.get(setting))) is not None:
            found.add(ForeignRegister(place=f"${setting}", title=title, number=number, written=True))
            found.leave(f"${setting}", number, "commands the drive, so it is named and never written")
    for setting in (465, 466, 467, 468, 469):
        if setting in given:
            found.leave(f"${setting}", given[setting], "a command or its scale, which is never sent from here")
    number, factor = whole_in(given.get(464)), ratio(whole_in(given.get(470)) or 0, whole_in(given.get(471)) or 0)
    if number is None:
        found.leave("$464", given.get(464, "missing"), "the register with the speed is not given")
    elif factor is None:
        scale = f"{given.get(470, 'missing')} / {given.get(471, 'missing')}"
        found.leave("$464", scale, "$470 and $471 do not say a factor that a decimal number expresses exactly")
    else:
        drive = whole_in(given.get(476, given.get(460)))
        found.assume("the speed is in rpm, which is what $470 and $471 make of the register")
        found.add(
            ForeignRegister(place="$464", title="spindle speed", number=number, unit="rpm", factor=factor, drive=drive)
        )
    for setting in (461, 472, 473):
        if setting in given:
            found.leave(f"${setting}", given[setting], "a setting of other spindles or of the program")
    return found
