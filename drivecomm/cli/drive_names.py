"""Drives as the command line names them: `PROTOCOL:ADDRESS`, with options behind commas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from drivecomm.errors import AddressError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveName:
    """A protocol, an address and drive options, such as model=act or baudrate=9600."""

    protocol: str
    address: int
    options: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.protocol}:{self.address}"


def parse_drive(text: str) -> DriveName:
    """Read `vabus:1` or `danfoss-fc:3,model=fc101,baudrate=19200`. Raises UsageError."""
    name, *settings = text.split(",")
    protocol, colon, address = name.partition(":")
    if not colon or not protocol:
        raise UsageError(f"{text!r} names no drive; a drive is PROTOCOL:ADDRESS, such as vabus:1")
    if not address.isascii() or not address.isdigit():
        raise AddressError(f"{address!r} in {text!r} is no address; a drive is PROTOCOL:ADDRESS, such as vabus:1")
    return DriveName(protocol=protocol, address=int(address), options=parse_settings(settings))


def parse_settings(settings: list[str]) -> dict[str, Any]:
    """Read `name=value` pairs: whole numbers (also 0x0F), decimals, true and false, or text. Raises UsageError."""
    chosen = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or not name:
            raise UsageError(f"{setting!r} is no option; write name=value")
        chosen[name.strip().replace("-", "_")] = _value(value.strip())
    return chosen


def _value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (lambda digits: int(digits, 0), float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
