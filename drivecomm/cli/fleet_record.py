"""Command `fleet record`: messages of a broker's plants, stored in a database."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options, signals
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.extras import must_have
from drivecomm.cli.fleet_options import broker_options
from drivecomm.cli.output import counted, note, tell
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.cli.fleet_options import BrokerOptions


@click.command(cls=CliCommand)
@click.option("--broker", required=True, metavar="URL", help="mqtt://HOST or mqtts://HOST, with a port if needed.")
@click.option("--to", "record", required=True, metavar="RECORD", help="postgresql://USER@HOST/DATABASE, or a file.")
@click.option(
    "--name", default="record", help="Client name under which the broker queues messages for an absent recorder."
)
@click.option("--share", metavar="WORD", help="Group name; recorders of the same group share the work.")
@click.option(
    "--levels",
    metavar="LEVELS",
    default="plant",
    help="The levels above the drives, as the plants' doors list them, such as site,area,line.",
)
@broker_options
@options.json
def record(
    *,
    broker: str,
    record: str,
    name: str,
    share: str | None,
    levels: str,
    reach: BrokerOptions,
    json: bool,
) -> int:
    """Record the plants of a broker in PostgreSQL, or in a file.

    Values, events, alarms and commands of all plants of an MQTT broker go there, until Ctrl-C or SIGTERM. The password
    of the database comes from ~/.pgpass or $PGPASSWORD. The recorder waits while broker or database are unavailable.
    Exit code 2 if another recorder begins under the same name.
    """
    must_have("a recorder", "mqtt", "aiomqtt")
    from drivecomm.server.record import BrokerRecorder, Layout, open_record

    for flag, word in (("--name", name), ("--share", share or "")):
        if set(word) & set("/+# ") or (not word and flag == "--name"):
            raise UsageError(f"invalid {flag} {word!r}; give a word without spaces, /, + and #")
    settings = reach.broker(broker)
    recorder = BrokerRecorder(
        settings,
        partial(open_record, record, insecure=reach.insecure),
        layout=Layout(reach.above, levels.split(",")),
        name=name,
        share=share or "",
        tell=note,
    )
    with signals.until_stopped() as end:
        recorder.run(end)
    said = f"{counted(recorder.values, 'value')} recorded"
    if recorder.unreadable:
        said += f", {counted(recorder.unreadable, 'message')} could not be read"
    tell(said, as_json=json, values=recorder.values, unreadable=recorder.unreadable)
    return 0
