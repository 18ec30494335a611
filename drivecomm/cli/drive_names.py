"""Drives as the command line names them: `PROTOCOL:ADDRESS`, or a name of the plant, with options behind commas."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.plant import Plant

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
    from drivecomm.plant import read_plant

    return read_plant(path)
