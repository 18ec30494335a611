"""`drivecomm stop --all` without what the other commands need: loading that takes longer than to stop a plant.

It knows the options that somebody in a hurry writes. With any other, and with a mistake, it does nothing, and the
command goes its usual way, which is the same but for the time.
"""

from __future__ import annotations

import os
from pathlib import Path

from drivecomm.protocol import Stop

_WITH_A_VALUE = {"--port": "port", "-p": "port", "--plant": "plant", "--how": "how"}


def stop_at_once(arguments: list[str]) -> int | None:
    """Stop everything and return the exit code; None, and nothing done, for arguments that it does not know."""
    given = given_in_haste(arguments)
    if given is None:
        return None
    from drivecomm.cli.drive_names import plant_file  # noqa: PLC0415 - not before the arguments are known
    from drivecomm.cli.output import complain, interrupted  # noqa: PLC0415 - not before the arguments are known
    from drivecomm.cli.stopping import Everything, stop_all  # noqa: PLC0415
    from drivecomm.errors import DriveCommError  # noqa: PLC0415

    as_json = "--json" in arguments
    plant = given.get("plant")
    port = given.get("port") or os.environ.get("DRIVECOMM_PORT") or None
    everything = Everything(
        port=port,
        plant=plant_file(Path(plant) if plant else None, port_given=port is not None),
        how=Stop(given.get("how", "ramp")),
    )
    try:
        return stop_all(everything, as_json=as_json)
    except DriveCommError as error:
        complain(error, as_json=as_json)
        return error.exit_code
    except KeyboardInterrupt:
        return interrupted(as_json=as_json)


def given_in_haste(arguments: list[str]) -> dict[str, str] | None:
    """Return the values of the options, None where there is anything else than them, --all and --json."""
    given: dict[str, str] = {}
    left = iter(arguments)
    for word in left:
        if word in ("--all", "--json"):
            continue
        name, equals, value = word.partition("=")
        if name not in _WITH_A_VALUE or (equals and not name.startswith("--")):
            return None
        found = value if equals else next(left, "")
        if not found or found.startswith("-"):
            return None
        given[_WITH_A_VALUE[name]] = found
    if "--all" not in arguments or given.get("how", "ramp") not in {stop.value for stop in Stop}:
        return None
    return given
