"""`stop --all` without typer, whose loading takes longer than stopping a plant.

Only the plain options are understood here. Any other, and any mistake, is left to typer, which understands these the
same way.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable

_WITH_A_VALUE = {"--port": "port", "-p": "port", "--plant": "plant", "--how": "how"}


def quick_stop(arguments: list[str]) -> Callable[[], int] | None:
    """Return what carries out `stop` with these arguments, None if typer has to read them."""
    given = quick_arguments(arguments)
    if given is None:
        return None
    from drivecomm.cli.line_options import LineOptions  # noqa: PLC0415 - not before the arguments are known
    from drivecomm.cli.stop.command import stop  # noqa: PLC0415

    plant = given.get("plant")
    line = LineOptions(
        port=given.get("port") or os.environ.get("DRIVECOMM_PORT") or None,
        plant=Path(plant) if plant else None,
        json="--json" in arguments,
        given=frozenset(given),
    )
    return partial(stop, line, everything=True, how=given.get("how", "ramp"))


def quick_arguments(arguments: list[str]) -> dict[str, str] | None:
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
