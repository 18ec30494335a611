"""FluidNC spindles: the telegrams of its ModbusVFD, as YAML.

Facts of the form: the FluidNC wiki, Modbus VFD: a command is the bytes of a request without address and check, `>`, and
the reply, with `rpm*60/10` where two bytes of it are a speed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from drivecomm.commissioning.importing.foreign_contents import ForeignContents, ForeignRegister
from drivecomm.commissioning.importing.meanings import ratio, whole_in

BUILT_IN = frozenset(
    ("Huanyang", "H2A", "H100", "YL620", "NowForever", "SiemensV20", "DanfossVLT2800", "FolinnVFD", "MollomG70")
)
"""Spindles whose telegrams are built into FluidNC and do not appear in its file."""

_SPEED = re.compile(r"(min|max)?rpm(?:\*(\d+))?(?:/(\d+))?", re.IGNORECASE)
_BYTE = re.compile(r"[0-9A-Fa-f]{2}")
_MODE = re.compile(r"([78])([NEO])([12])", re.IGNORECASE)
_READS = {0x03: "", 0x04: "i"}
_WRITES = {0x05: "c", 0x06: "", 0x0F: "c", 0x10: ""}
_TITLES = {"": "spindle speed", "min": "lowest spindle speed", "max": "highest spindle speed"}


class _Request(NamedTuple):
    function: int
    start: int
    registers: int


def fluidnc_configuration(content: Mapping[str, Any]) -> ForeignContents | None:
    """Return the registers of the spindle in a configuration, None if it has no Modbus spindle."""
    spindle = content.get("ModbusVFD")
    for name in BUILT_IN & content.keys():
        found = ForeignContents(form="FluidNC configuration (YAML)", title=name)
        found.leave(name, None, "FluidNC has the registers of this spindle built in; the file does not list them")
        if not isinstance(spindle, Mapping):
            return found
    if not isinstance(spindle, Mapping):
        return None
    found = ForeignContents(form="FluidNC configuration (YAML)", title=str(spindle.get("model") or "spindle drive"))
    _line(found, content.get(f"uart{spindle.get('uart_num', '')}"))
    drive = whole_in(spindle.get("modbus_id", 1))
    for key, command in spindle.items():
        if str(key).startswith("get_") and str(key).endswith("_cmd"):
            _reading(found, str(key), str(command), drive)
        elif str(key).endswith("_cmd"):
            _command(found, str(key), str(command))
    return found


def _line(found: ForeignContents, uart: object) -> None:
    if not isinstance(uart, Mapping):
        return
    if "baud" in uart:
        found.take_line("uart", {"baudrate": uart["baud"]})
    if mode := _MODE.fullmatch(str(uart.get("mode", ""))):
        found.options |= {"bytesize": int(mode[1]), "parity": mode[2].upper(), "stopbits": int(mode[3])}


def _reading(found: ForeignContents, key: str, command: str, drive: int | None) -> None:
    asked, arrow, replied = command.partition(">")
    request = _request(asked)
    if request is None or request.function not in _READS:
        found.leave(key, command, "not a request of Modbus that reads registers")
        return
    words = replied.split()
    # The reply begins with its function code and its number of bytes; two bytes make a register.
    if not arrow or [int(word, 16) if _BYTE.fullmatch(word) else None for word in words[:2]] != [
        request.function,
        2 * request.registers,
    ]:
        found.leave(key, command, "the reply is not that of the request")
        return
    byte = 0
    for word in words[2:]:
        speed = _SPEED.fullmatch(word)
        if speed is None:
            byte += 1
            continue
        factor = ratio(int(speed[2] or 1), int(speed[3] or 1))
        if byte % 2 or factor is None:
            found.leave(key, word, "not a register, or not a factor that a decimal number expresses exactly")
        else:
            found.add(
                ForeignRegister(
                    place=key, title=_TITLES[(speed[1] or "").lower()], kind=_READS[request.function],
                    number=request.start + byte // 2, unit="rpm", factor=factor, drive=drive,
                )
            )  # fmt: skip
        byte += 2


def _command(found: ForeignContents, key: str, command: str) -> None:
    request = _request(command.partition(">")[0])
    if request is not None and request.function in _WRITES:
        kind = _WRITES[request.function]
        found.add(
            ForeignRegister(
                place=key, title="command register", kind=kind, number=request.start, type="" if kind else "u16",
                written=True,
            )
        )  # fmt: skip
    found.leave(key, command, "a command, which is never sent from here")


def _request(text: str) -> _Request | None:
    """Return the read request in the first five bytes; further bytes, and bytes that stand for a speed, are ignored."""
    words = text.split()
    head = [int(word, 16) for word in words[:3] if _BYTE.fullmatch(word)]
    if len(head) < 3:
        return None
    rest = [int(word, 16) for word in words[3:5] if _BYTE.fullmatch(word)]
    if head[0] in _READS and (len(rest) < 2 or len(words) != 5):
        return None
    return _Request(head[0], head[1] << 8 | head[2], rest[0] << 8 | rest[1] if len(rest) == 2 else 1)
