"""Entry of the stop command, which parses plain options without click, to import less before a motor stops.

All other options, and all mistakes, are left to click, which parses the plain ones in the same way.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import LineArguments
from drivecomm.errors import UsageError, suggestion
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


def stop_motors(line: LineArguments, drives: Sequence[str], *, everything: bool, how: str, model: str | None) -> int:
    """Stop the named drives, or everything, and return the exit code. Raises UsageError."""
    try:
        chosen = Stop(how.lower().replace("-", "_"))
    except ValueError:
        known = suggestion(how, [stop.value for stop in Stop], "use one of")
        raise UsageError(f"unknown kind of stop {how!r}; {known}") from None
    if not everything:
        if not drives:
            raise UsageError("no drive given; write PROTOCOL:ADDRESS, or --all to stop everything")
        return _stop_named(line, drives, model, chosen)
    if drives:
        raise UsageError(f"--all stops everything; leave {' '.join(drives)} out, or leave --all out")
    from drivecomm.cli.stop.everything import stop_all

    return stop_all(line, _plant_file(line), chosen)


def _plant_file(line: LineArguments) -> Path | None:
    """Return the plant file of a call; None also if it is not accessible, such as in a protected folder."""
    try:
        return plant_file(line.plant, port_given="port" in line.given)
    except Exception:  # noqa: BLE001 - a port or its server may still work
        return None


def _stop_named(line: LineArguments, drives: Sequence[str], model: str | None, how: Stop) -> int:
    if len(drives) > 1:
        if everybody := [each for each in drives if each.endswith(":*")]:
            raise UsageError(f"{everybody[0]} stops all drives of a protocol; give it alone, or use --all")
        from drivecomm.cli.stop.several import stop_several

        return stop_several(line, drives, model, how)
    (drive,) = drives
    protocol, _, address = drive.partition(":")
    plant = _plant_file(line) if address == "*" else None
    if plant is not None and "port" not in line.given:
        # Separate modules, so that neither kind of stop imports the other.
        from drivecomm.cli.stop.everything import stop_protocol

        return stop_protocol(line, plant, protocol, model, how)
    from drivecomm.cli.stop.one_drive import stop_one

    return stop_one(line, drive, model, how)


def quick_stop(arguments: list[str]) -> Callable[[], int] | None:
    """Return a function that runs `stop` with these arguments, None if click has to parse them."""
    given = quick_arguments(arguments)
    if given is None:
        return None
    plant = given.get("plant")
    line = LineArguments(
        port=given.get("port") or os.environ.get("DRIVECOMM_PORT") or None,
        plant=Path(plant) if plant else None,
        json="--json" in arguments,
        given=frozenset({"port", "plant"} & given.keys()),
    )
    how, model = given.get("how", "ramp"), given.get("model")
    drives = given.get("drives", "").split()
    return partial(stop_motors, line, drives, everything="--all" in arguments, how=how, model=model)


def quick_arguments(arguments: list[str]) -> dict[str, str] | None:
    """Return the drives and the values of the options; None if there is any other argument, except --all and --json.

    drives: separated by spaces; a name with a space is left to click.
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
