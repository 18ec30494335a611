"""Paths of a server's own files: one state folder for each plant file."""

from __future__ import annotations

import os
from pathlib import Path

from drivecomm.client import identity


def state_folder(plant: Path) -> Path:
    """Return the folder for files that outlive a server: that of the service manager, or the user's."""
    # A service manager may name several folders; the first is the main one.
    given = os.environ.get("STATE_DIRECTORY", "").partition(os.pathsep)[0]
    if given:
        return Path(given) / identity(plant)
    from platformdirs import user_state_path

    return user_state_path("drivecomm", appauthor=False) / identity(plant)


def audit_file(plant: Path) -> Path:
    """Return the default path of the audit."""
    return state_folder(plant) / "audit.jsonl"


def history_file(plant: Path) -> Path:
    """Return the default path of the history."""
    return state_folder(plant) / "history.sqlite"
