"""Drives as the command line names them: `PROTOCOL:ADDRESS`, or a name of the plant, with options behind commas."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import AddressError, UsageError

if TYPE_CHECKING:
    from drivecomm.plant import Plant, PlantDrive, PlantLine

PLANT_VARIABLE = "DRIVECOMM_PLANT"
PLANT_FILE = Path("plant.toml")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPlant:
    """The plant that names on the command line are looked up in. file: as it was said, for messages."""

    plant: Plant
    file: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantPlace:
    """A drive of a plant, and its line, as a name on the command line found them."""

    name: DriveName
    drive: PlantDrive
    line: PlantLine
    file: str


def plant_file(given: Path | None, *, port_given: bool) -> Path | None:
    """Return the plant file of a call, see `known_plant`."""
    if given is not None or port_given:
        return given
    said = os.environ.get(PLANT_VARIABLE, "")
    return Path(said) if said else PLANT_FILE if PLANT_FILE.is_file() else None


def known_plant(given: Path | None, *, port_given: bool) -> KnownPlant | None:
    """Return the plant of a call: of the file that is given, that DRIVECOMM_PLANT names, or plant.toml in this folder.

    The last two count only where no port is given, None where there is none. Raises FileFormatError for a file that is
    no plant.
    """
    path = plant_file(given, port_given=port_given)
    if path is None:
        return None
    # Loaded by those who have a plant only.
    from drivecomm.plant.files import read_plant  # noqa: PLC0415

    return KnownPlant(plant=read_plant(path), file=str(path))


def placed(text: str, given: Path | None, *, port_given: bool, arm: bool) -> PlantPlace | None:
    """Return the place of a drive in the plant; None for PROTOCOL:ADDRESS that no plant is known for, or has.

    arm: the person at the command line takes it on themselves to command a drive that is not armed. Raises UsageError
    for a name that no plant has.
    """
    word, *settings = text.split(",")
    is_name = ":" not in word
    # A name is looked up whatever port is given: nothing else can be meant.
    known = known_plant(given, port_given=port_given and not is_name)
    if known is None:
        if is_name:
            raise UsageError(
                f"{text!r} names no drive; a drive is PROTOCOL:ADDRESS, such as vabus:1, or a name in a plant file "
                "(--plant plant.toml)"
            )
        return None
    try:
        drive = known.plant.drive(word)
    except UsageError as error:
        if not is_name and given is None:
            return None
        raise UsageError(f"{known.file}: {error}") from error
    reason = "" if arm else drive.why_read_only(known.file)
    refusal = {"read_only": f"{reason}, or give --arm for this once"} if reason else {}
    options = {**drive.options, **parse_settings(settings), **refusal}
    return PlantPlace(
        name=DriveName(protocol=drive.protocol, address=drive.address, options=options),
        drive=drive,
        line=known.plant.line(drive.line),
        file=known.file,
    )


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
