"""Drives as the command line names them: `PROTOCOL:ADDRESS`, or a name of the plant, with options behind commas."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import AddressError, UsageError
from drivecomm.transport import same_port

if TYPE_CHECKING:
    from drivecomm.plant import Plant, PlantDrive, PlantLine

PLANT_VARIABLE = "DRIVECOMM_PLANT"
PLANT_FILE = Path("plant.toml")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveName:
    """A protocol, an address and drive options, such as model=act or baudrate=9600.

    name: what the plant calls it, PROTOCOL:ADDRESS where none does. line: the plant's name of its line, the port where
    there is no plant; empty as long as nobody has looked.
    """

    protocol: str
    address: int
    options: dict[str, Any] = field(default_factory=dict)
    name: str = ""
    line: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", str(self))

    def __str__(self) -> str:
        return f"{self.protocol}:{self.address}"

    @property
    def keys(self) -> dict[str, str]:
        """How a JSON object names the drive that it is about."""
        return {"name": self.name, "drive": str(self), "line": self.line}


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

    def drive(self, word: str) -> PlantDrive:
        """Return a drive of it. Raises UsageError that names the file."""
        try:
            return self.plant.drive(word)
        except UsageError as error:
            raise UsageError(f"{self.file}: {error}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantPlace:
    """A drive of a plant, and its line, as a name on the command line found them. settings: what was said behind it."""

    name: DriveName
    settings: dict[str, Any]
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
    from drivecomm.plant import read_plant  # noqa: PLC0415

    return KnownPlant(plant=read_plant(path), file=str(path))


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What a call says of plant and port. port_said: it was written on the command line, and not in the environment."""

    plant: Path | None
    port: str | None
    port_said: bool
    arm: bool


def placed(text: str, asked: Asked) -> PlantPlace | None:
    """Return the place of a drive in the plant; None for PROTOCOL:ADDRESS that no plant is known for, or has.

    With a port, PROTOCOL:ADDRESS is the plant's drive if that is where the plant has it: what the plant says of a drive
    holds however it is named. Raises UsageError for a name that no plant has, and for one that is on another port.
    """
    word, *settings = text.split(",")
    known = known_plant(asked.plant, port_given=False)
    drive = _named(word, known) if ":" not in word else _addressed(word, known, asked)
    if known is None or drive is None:
        return None
    line = known.plant.line(drive.line)
    if asked.port_said and asked.port and line.reached_at and not same_port(line.reached_at, asked.port):
        raise UsageError(
            f"{known.file}: {drive.name} is on line {line.name}, at {line.reached_at}; leave --port {asked.port} out, "
            f"or name a drive as PROTOCOL:ADDRESS there"
        )
    reason = drive.why_read_only(known.file)
    if asked.arm and not reason:
        raise UsageError(f"{drive.name} is armed in {known.file}, so that --arm has no effect; leave it out")
    refusal = {"read_only": f"{reason}, or give --arm for this once"} if reason and not asked.arm else {}
    options = {**drive.options, **refusal}
    name = DriveName(protocol=drive.protocol, address=drive.address, options=options, name=drive.name, line=drive.line)
    return PlantPlace(name=name, settings=parse_settings(settings), drive=drive, line=line, file=known.file)


def _named(word: str, known: KnownPlant | None) -> PlantDrive:
    if known is None:
        raise UsageError(
            f"{word!r} names no drive; a drive is PROTOCOL:ADDRESS, such as vabus:1, or a name in a plant file "
            "(--plant plant.toml)"
        )
    return known.drive(word)


def _addressed(word: str, known: KnownPlant | None, asked: Asked) -> PlantDrive | None:
    if known is None:
        return None
    same = [drive for drive in known.plant.drives if f"{drive.protocol}:{drive.address}" == word]
    if asked.port is not None and (asked.port_said or asked.plant is None):
        port = asked.port
        lines = {line.name for line in known.plant.lines if not line.reached_at or same_port(line.reached_at, port)}
        here = [drive for drive in same if drive.line in lines]
        if asked.plant is None or here:
            return min(here, key=lambda drive: drive.armed, default=None)
    if not same and asked.plant is None:
        return None
    return known.drive(word)


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
