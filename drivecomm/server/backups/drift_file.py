"""The file that preserves the drift of the drives over restarts of the server."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text, parsed, plain
from drivecomm.server.drift_state import DriveDrift, NotComparable, SetChange
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_FORMAT = 1


def write_drifts(file: Path, drifts: Mapping[str, DriveDrift]) -> None:
    """Replace the file with these drifts, by drive. Raises FileFormatError and OSError."""
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_atomically(file, json_text(plain({"format": _FORMAT, "drives": dict(drifts)})) + "\n")


def read_drifts(file: Path) -> dict[str, DriveDrift]:
    """Return the stored drifts by drive; none if the file is missing or damaged, so each drive is compared again."""
    try:
        content = parsed(file.read_bytes())
        if content["format"] != _FORMAT:
            return {}
        return {str(drive): _drift(known) for drive, known in content["drives"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _drift(known: dict[str, Any]) -> DriveDrift:
    return DriveDrift(**{
        **known,
        "changes": tuple(SetChange(**{**each, "since_s": float(each["since_s"])}) for each in known["changes"]),
        "not_comparable": tuple(NotComparable(**each) for each in known["not_comparable"]),
        "untold": tuple(known["untold"]),
        **{key: None if known[key] is None else float(known[key])
           for key in ("replaced_since_s", "approved_s", "compared_s")},
    })  # fmt: skip
