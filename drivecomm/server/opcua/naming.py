"""Names in the address space: browse names and folders, node ids, and units with their UNECE codes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.line import STATUS

if TYPE_CHECKING:
    from collections.abc import Mapping

OTHERS = "Parameters"
"""Folder of values without a common name."""

_UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"

# Our unit -> its code in UNECE Recommendation 20, and its name there.
_CODES: Mapping[str, tuple[str, str]] = {
    "Hz": ("HTZ", "hertz"),
    "kHz": ("KHZ", "kilohertz"),
    "A": ("AMP", "ampere"),
    "mA": ("4K", "milliampere"),
    "V": ("VLT", "volt"),
    "mV": ("2Z", "millivolt"),
    "kV": ("KVT", "kilovolt"),
    "W": ("WTT", "watt"),
    "kW": ("KWT", "kilowatt"),
    "Wh": ("WHR", "watt hour"),
    "kWh": ("KWH", "kilowatt hour"),
    "MWh": ("MWH", "megawatt hour"),
    "Nm": ("NU", "newton metre"),
    "%": ("P1", "percent"),
    "rpm": ("RPM", "revolutions per minute"),
    "1/min": ("RPM", "revolutions per minute"),
    "degC": ("CEL", "degree Celsius"),
    "°C": ("CEL", "degree Celsius"),
    "ms": ("C26", "millisecond"),
    "s": ("SEC", "second"),
    "min": ("MIN", "minute"),
    "h": ("HUR", "hour"),
}
_NO_CODE = -1


@dataclass(frozen=True, slots=True)
class ValueLocation:
    """Folder and browse name of a value below its drive."""

    folder: str
    name: str


@cache
def places() -> Mapping[str, ValueLocation]:
    """Return folder and browse name of each common name."""
    import tomllib
    from importlib import resources

    text = resources.files("drivecomm.server.opcua").joinpath("browse_names.toml").read_text(encoding="utf-8")
    return MappingProxyType(
        {
            name: ValueLocation(folder, shown)
            for folder, table in tomllib.loads(text).items()
            for name, shown in table.items()
        }
    )


def place_of(name: str) -> ValueLocation:
    """Return folder and browse name of a value with this name in the plant."""
    return places().get(name) or ValueLocation(OTHERS, name)


def value_path(drive: str, name: str) -> tuple[str, ...]:
    """Return the parts of the node id of a value; for the status, those of its state."""
    place = ValueLocation("Status", "State") if name == STATUS else place_of(name)
    return "drives", part(drive), place.folder, part(place.name)


@cache
def engineering_unit(unit: str) -> ua.EUInformation:
    """Return the OPC UA description of a unit; a unit without a UNECE code has only its name."""
    code, words = _CODES.get(unit, ("", unit))
    return ua.EUInformation(
        NamespaceUri=_UNECE if code else "",
        # The characters of the code, read as bytes of a number.
        UnitId=int.from_bytes(code.encode(), "big") if code else _NO_CODE,
        DisplayName=ua.LocalizedText(unit),
        Description=ua.LocalizedText(words),
    )


def part(name: str) -> str:
    """Return a name as one part of a node id, with slashes quoted."""
    return name.replace("%", "%25").replace("/", "%2F")
