"""Names of drives on the command line: `PROTOCOL:ADDRESS`, or a name in the plant, with options after commas."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.plant import Plant

PLANT_VARIABLE = "DRIVECOMM_PLANT"
PLANT_FILE = Path("plant.toml")


def plant_file(given: Path | None, *, port_given: bool) -> Path | None:
    """Return the path of the plant file of a call; see `known_plant`."""
    if given is not None or port_given:
        return given
    said = os.environ.get(PLANT_VARIABLE, "")
    return Path(said) if said else PLANT_FILE if PLANT_FILE.is_file() else None


def known_plant(given: Path | None, *, port_given: bool) -> Plant | None:
    """Return the plant of a call, from the given file, the file in DRIVECOMM_PLANT, or plant.toml in this folder.

    The last two count only if no port is given. Returns None without a plant file. Raises FileFormatError for a file
    that is not a plant.
    """
    path = plant_file(given, port_given=port_given)
    if path is None:
        return None
    # Imported late, because only calls with a plant need it.
    from drivecomm.plant import read_plant

    return read_plant(path)
