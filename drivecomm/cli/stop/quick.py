"""What the stop command does, and how its plain options are read without click, to load less before a motor stops.

Any other option, and any mistake, is left to click, which reads these the same way.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import LineOptions
from drivecomm.errors import UsageError, meant
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


_WITH_A_VALUE = {
    "--port": "port",
    "-p": "port",
    "--plant": "plant",
    "--how": "how",
    "--model": "model",
    "-m": "model",
}


def stop_motors(line: LineOptions, drives: Sequence[str], *, everything: bool, how: str, model: str | None) -> int:
    """Stop the drives that are named, or everything, and return the exit code. Raises UsageError."""
    try:
        chosen = Stop(how.lower().replace("-", "_"))
    except ValueError:
        known = meant(how, [stop.value for stop in Stop], "use one of")
        raise UsageError(f"unknown kind of stop {how!r}; {known}") from None
    if not everything:
        if not drives:
            raise UsageError("no drive given; write PROTOCOL:ADDRESS, or --all to stop everything")
        return _stop_named(line, drives, model, chosen)
    if drives:
        raise UsageError(f"--all stops everything; leave {' '.join(drives)} out, or leave --all out")
    from drivecomm.cli.stop.everything import stop_all

    return stop_all(line, _plant_file(line), chosen)


def _plant_file(line: LineOptions) -> Path | None:
    """Return the plant file of a call; None also where that cannot be seen, such as in a folder that is closed."""
    try:
        return plant_file(line.plant, port_given="port" in line.given)
    except Exception:  # noqa: BLE001 - a port, or its server, may be left
        return None


def _stop_named(line: LineOptions, drives: Sequence[str], model: str | None, how: Stop) -> int:
    if len(drives) > 1:
        if everybody := [each for each in drives if each.endswith(":*")]:
            raise UsageError(f"{everybody[0]} stops all drives of a protocol; give it by itself, or use --all")
        from drivecomm.cli.stop.several import stop_several

        return stop_several(line, drives, model, how)
    (drive,) = drives
    protocol, _, address = drive.partition(":")
    plant = _plant_file(line) if address == "*" else None
    if plant is not None and "port" not in line.given:
        # Kept apart, because nothing of it must be loaded to stop one drive, nor the other way round.
        from drivecomm.cli.stop.everything import stop_protocol

        return stop_protocol(line, plant, protocol, model, how)
    from drivecomm.cli.stop.one_drive import stop_one

    return stop_one(line, drive, model, how)


def quick_stop(arguments: list[str]) -> Callable[[], int] | None:
    """Return what carries out `stop` with these arguments, None if click has to read them."""
    given = quick_arguments(arguments)
    if given is None:
        return None
    plant = given.get("plant")
    line = LineOptions(
        port=given.get("port") or os.environ.get("DRIVECOMM_PORT") or None,
        plant=Path(plant) if plant else None,
        json="--json" in arguments,
        given=frozenset({"port", "plant"} & given.keys()),
    )
    how, model = given.get("how", "ramp"), given.get("model")
    drives = given.get("drives", "").split()
    return partial(stop_motors, line, drives, everything="--all" in arguments, how=how, model=model)


def quick_arguments(arguments: list[str]) -> dict[str, str] | None:
    """Return the drives and the values of the options; None where there is anything but these, --all and --json.

    drives: with spaces between them; one that has a space is left to click.
    """
    given: dict[str, str] = {}
    left = iter(arguments)
    for word in left:
        if word in ("--all", "--json"):
            continue
        name, equals, value = word.partition("=")
        if word and not word.startswith("-"):
            if word.split() != [word]:
                return None
            given["drives"] = f"{given.get('drives', '')} {word}".strip()
            continue
        if name not in _WITH_A_VALUE or (equals and not name.startswith("--")):
            return None
        found = value if equals else next(left, "")
        if not found or found.startswith("-"):
            return None
        given[_WITH_A_VALUE[name]] = found
    if ("--all" in arguments) == ("drives" in given) or given.get("how", "ramp") not in {stop.value for stop in Stop}:
        return None
    return given
