"""Command `fleet acknowledge`: requests to the server of a plant over the broker; the server checks the permission."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from drivecomm.cli import event_loop, options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.extras import must_have
from drivecomm.cli.fleet_options import broker_options
from drivecomm.cli.output import tell
from drivecomm.cli.values import FILE

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.cli.fleet_options import BrokerOptions


@click.command(cls=CliCommand)
@click.argument("broker", help="mqtt://HOST or mqtts://HOST, with a port if needed.")
@click.argument("plant", help="Its name, as fleet shows it.")
@click.argument("alarms", metavar="ID...", nargs=-1, required=True, help="Ids of alarms, as fleet alarms shows them.")
@click.option("--token-file", type=FILE, help="A file with the token of a user of the plant, in its first line.")
@broker_options
@options.json
def acknowledge(
    *,
    broker: str,
    plant: str,
    alarms: tuple[str, ...],
    token_file: Path | None,
    reach: BrokerOptions,
    json: bool,
) -> int:
    """Acknowledge alarms of a plant, as its server allows: by the token of a user, or by the role of the door.

    Exit code 2 when the server refuses, 3 when the broker cannot be reached or the server does not answer.
    """
    must_have("a fleet", "mqtt", "aiomqtt")
    from drivecomm.server.broker import first_line
    from drivecomm.server.fleet import Fleet, acknowledge_over_broker

    settings = reach.broker(broker)
    known = Fleet(reach.above)
    token = "" if token_file is None else first_line(token_file)
    for alarm in alarms:
        done = event_loop.run(partial(acknowledge_over_broker, settings, known, plant, alarm, token))
        said = f"{done['id']}  {done['drive']}  {done['rule']}: acknowledged by {done['acknowledged_by']}"
        tell(said, as_json=json, plant=plant, **done)
    return 0
