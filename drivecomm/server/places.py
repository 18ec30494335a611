"""Where a server keeps what is its own: one folder for each plant, by the plant's file."""

from __future__ import annotations

import os
from pathlib import Path

from drivecomm.client import identity


def state_folder(plant: Path) -> Path:
    """Return the folder for what outlives a server: that of the service manager, or the user's."""
    # A service manager may name several, the first for all that is not said otherwise.
    given = os.environ.get("STATE_DIRECTORY", "").partition(os.pathsep)[0]
    if given:
        return Path(given) / identity(plant)
    from platformdirs import user_state_path

    return user_state_path("drivecomm", appauthor=False) / identity(plant)


def audit_file(plant: Path) -> Path:
    """Return where the audit is, unless the plant file says another place."""
    return state_folder(plant) / "audit.jsonl"


def history_file(plant: Path) -> Path:
    """Return where the history is, unless the plant file says another place."""
    return state_folder(plant) / "history.sqlite"
