"""Commands `alarms list` and `alarms acknowledge`: the alarms of a running server."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import PLANT_FILE, plant_file
from drivecomm.cli.output import emit, say
from drivecomm.cli.time_ranges import clock
from drivecomm.cli.values import FILE
from drivecomm.client import LocalServer, server_of_plant
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_plant_option = click.option("--plant", type=FILE, help="Plant file. Default: $DRIVECOMM_PLANT or plant.toml here.")


@click.command("list", cls=CliCommand)
@_plant_option
@options.json
def list_alarms(*, plant: Path | None, json: bool) -> int:
    """List the active alarms of a running server.

    They are current, or acknowledged, or over and not acknowledged yet.
    """
    with closing(_server(plant)) as server:
        found = server.ask("/api/v1/alarms")
    for alarm in found:
        if json:
            emit(**alarm, state=_state(alarm))
        else:
            say(_row(alarm))
    if not found and not json:
        say("no alarms")
    return 0


@click.command(cls=CliCommand)
@click.argument("alarms", metavar="ID...", nargs=-1, required=True, help="Ids of alarms, as list shows them.")
@_plant_option
@options.json
def acknowledge(*, alarms: tuple[str, ...], plant: Path | None, json: bool) -> int:
    """Acknowledge alarms of a running server by their ids.

    No more reminders are sent for them, and those that are over leave the list.
    """
    with closing(_server(plant)) as server:
        for each in alarms:
            done = server.order(f"/api/v1/alarms/{quote(each, safe='')}/acknowledge", {})
            if json:
                emit(**done, state=_state(done))
            else:
                say(_row(done))
    return 0


def _server(plant: Path | None) -> LocalServer:
    path = plant_file(plant, port_given=False) or PLANT_FILE
    found = server_of_plant(path)
    if found is None:
        raise UsageError(
            f"no server is running for {path}, and only a server raises alarms; start it with: drivecomm serve {path}"
        )
    return LocalServer(found)


def _state(alarm: Mapping[str, Any]) -> str:
    if alarm["over_s"] is not None:
        return "over"
    return "acknowledged" if alarm["acknowledged_by"] else "current"


def _row(alarm: Mapping[str, Any]) -> str:
    state = _state(alarm)
    often = f", {alarm['times']} times" if alarm["times"] > 1 else ""
    ended = f", over at {clock(float(alarm['over_s']))}" if state == "over" else ""
    by = f", acknowledged by {alarm['acknowledged_by']}" if alarm["acknowledged_by"] else ""
    begun = f"since {clock(float(alarm['since_s']))}"
    return f"{alarm['id']}  {state:<12}  {alarm['drive']}  {alarm['rule']}: {alarm['text']}{often}, {begun}{ended}{by}"
