"""Drives as the command line names them: `PROTOCOL:ADDRESS`, or a name of the plant, with options behind commas."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.protocol import parse_options
from drivecomm.transport import same_port

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig

PLANT_VARIABLE = "DRIVECOMM_PLANT"
PLANT_FILE = Path("plant.toml")


def plant_file(given: Path | None, *, port_given: bool) -> Path | None:
    """Return the plant file of a call, see `known_plant`."""
    if given is not None or port_given:
        return given
    said = os.environ.get(PLANT_VARIABLE, "")
    return Path(said) if said else PLANT_FILE if PLANT_FILE.is_file() else None


def known_plant(given: Path | None, *, port_given: bool) -> Plant | None:
    """Return the plant of a call: of the file that is given, that DRIVECOMM_PLANT names, or plant.toml in this folder.

    The last two count only where no port is given, None where there is none. Raises FileFormatError for a file that is
    no plant.
    """
    path = plant_file(given, port_given=port_given)
    if path is None:
        return None
    # Loaded by those who have a plant only.
    from drivecomm.plant import read_plant  # noqa: PLC0415

    return read_plant(path)


def placed(text: str, asked: LineOptions) -> tuple[Plant, DriveConfig, dict[str, Any]] | None:
    """Return the plant, its drive, and the options behind its name; None for PROTOCOL:ADDRESS that no plant has.

    With a port, PROTOCOL:ADDRESS is the plant's drive if that is where the plant has it: what the plant says of a drive
    holds however it is named. Raises UsageError for a name that no plant has, and for one that is on another port.
    """
    word, *settings = text.split(",")
    known = known_plant(asked.plant, port_given=False)
    if known is None:
        if ":" in word:
            return None
        raise UsageError(
            f"{word!r} is not a drive; write PROTOCOL:ADDRESS, such as vabus:1, or a name in a plant file "
            "(--plant plant.toml)"
        )
    drive = _addressed(word, known, asked) if ":" in word else known.drive(word)
    if drive is None:
        return None
    line = known.line(drive.line)
    if "port" in asked.given and asked.port and line.reached_at and not same_port(line.reached_at, asked.port):
        raise UsageError(
            f"{known.file}: {drive.name} is on line {line.name}, at {line.reached_at}; leave --port {asked.port} out, "
            f"or name a drive as PROTOCOL:ADDRESS there"
        )
    reason = drive.why_read_only(known.file)
    if asked.arm and not reason:
        raise UsageError(f"{drive.name} is armed in {known.file}, so --arm has no effect; leave it out")
    if reason and not asked.arm:
        drive = replace(drive, read_only_reason=f"{reason}, or give --arm for this once")
    return known, drive, parse_options(settings)


def _addressed(word: str, known: Plant, asked: LineOptions) -> DriveConfig | None:
    same = [drive for drive in known.drives if str(drive) == word]
    if asked.port is not None and ("port" in asked.given or asked.plant is None):
        port = asked.port
        lines = {line.name for line in known.lines if not line.reached_at or same_port(line.reached_at, port)}
        here = [drive for drive in same if drive.line in lines]
        if asked.plant is None or here:
            return min(here, key=lambda drive: drive.armed, default=None)
    if not same and asked.plant is None:
        return None
    return known.drive(word)
