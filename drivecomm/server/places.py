"""Where a server keeps what is its own: one folder for each plant, by the plant's file."""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path


def plant_id(plant: Path) -> str:
    """Return what the plant of a file is called in folders that several plants share, such as plant-1f3a9c04.

    The same file has the same name, by whatever path or link it is called.
    """
    real = os.path.realpath(plant)
    return f"{Path(real).stem}-{sha256(os.fsencode(real)).hexdigest()[:8]}"


def state_folder(plant: Path) -> Path:
    """Return the folder for what outlives a server: that of the service manager, or the user's."""
    # A service manager may name several, the first for all that is not said otherwise.
    given = os.environ.get("STATE_DIRECTORY", "").partition(os.pathsep)[0]
    if given:
        return Path(given) / plant_id(plant)
    from platformdirs import user_state_path  # noqa: PLC0415 - only where no service manager says it

    return user_state_path("drivecomm", appauthor=False) / plant_id(plant)


def audit_file(plant: Path) -> Path:
    """Return where the audit is, unless the plant file says another place."""
    return state_folder(plant) / "audit.jsonl"


def history_file(plant: Path) -> Path:
    """Return where the history is, unless the plant file says another place."""
    return state_folder(plant) / "history.sqlite"
