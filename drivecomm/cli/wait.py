"""The wait command: until a drive is in a state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.options import Drive, Model
from drivecomm.cli.status import show_status
from drivecomm.errors import UsageError, meant
from drivecomm.protocol import DriveState

if TYPE_CHECKING:
    from drivecomm.bus import Goal


def wait(
    drive: Drive,
    state: Annotated[str, typer.Argument(help="ready, running, stopping, fault, not_ready or at_reference.")],
    line: LineOptions,
    seconds: Annotated[float, typer.Option("--seconds", help="How long at most.")] = 10.0,
    model: Model = None,
) -> int:
    """Wait until a drive reaches a state. Exit code 5 when it does not reach it in time, or has a fault."""
    goals: dict[str, Goal] = {"at_reference": "at_reference", **{each.value: each for each in DriveState}}
    goal = goals.get(state.lower().replace("-", "_"))
    if goal is None:
        raise UsageError(f"unknown state {state!r}; {meant(state, goals, 'write one of')}")
    with line.drive(drive, model) as (one, name):
        show_status(name, one.wait_for(goal, seconds), as_json=line.json)
    return 0
