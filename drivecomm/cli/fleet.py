"""Command `fleet show`: all plants that publish to a broker at a glance, or the drives of one plant."""

from __future__ import annotations

import asyncio
import time
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING

import click

from drivecomm.cli import event_loop, options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.extras import must_have
from drivecomm.cli.fleet_options import broker_options
from drivecomm.cli.output import counted, emit, note, print_columns, say
from drivecomm.errors import DriveError, NoReplyError, UsageError, suggestion
from drivecomm.line import FRESH
from drivecomm.tomlfile import TomlTable

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.cli.fleet_options import BrokerOptions
    from drivecomm.server.broker import BrokerSettings
    from drivecomm.server.fleet import Fleet, FleetDrive, FleetPlant, PlantSummary
    from drivecomm.server.record import Database

_HEAD = (
    *("plant", "server", "drives", "answer", "running", "faults", "silent", "alarms", "read"),
    *("version", "file", "file read"),
)
_DRIVES_HEAD = ("drive", "model", "state", "output", "current", "read")
_GATEWAYS = {"online": "connected", "offline": "not connected", "unknown": "not known"}


@click.command(cls=CliCommand)
@click.argument("broker", help="mqtt://HOST or mqtts://HOST, with a port if needed.")
@click.argument("plant", required=False, help="Show the drives of this plant. Default: all plants.")
@broker_options
@click.option("--listen", metavar="HOST:PORT", help="Serve the fleet as a web page, such as 127.0.0.1:8090.")
@click.option("--from", "record", metavar="RECORD", help="With --listen: show alarms and trends from this record.")
@options.json
def fleet(
    *,
    broker: str,
    plant: str | None,
    reach: BrokerOptions,
    listen: str | None,
    record: str | None,
    json: bool,
) -> int:
    """Show the plants whose servers publish to an MQTT broker; it contacts no server and commands nothing.

    Exit code 5 when a drive has a fault, 4 when a server is not connected or a drive does not answer, 3 when the broker
    cannot be reached.
    """
    must_have("a fleet", "mqtt", "aiomqtt")
    if listen is not None:
        must_have("the page of a fleet", "server", "starlette", "uvicorn")
    from drivecomm.server.fleet import Fleet
    from drivecomm.server.record import open_record

    settings = reach.broker(broker)
    known = Fleet(reach.above)
    if listen is not None:
        if plant is not None or json:
            raise UsageError("--listen serves a page of all plants; leave PLANT and --json out")
        open_database = None if record is None else partial(open_record, record, insecure=reach.insecure)
        event_loop.run(partial(_serve, settings, known, listen, open_database))
        return 0
    if record is not None:
        raise UsageError("--from needs --listen; in the terminal, use fleet history or fleet alarms")
    event_loop.run(partial(_heard, settings, known))
    if known.unreadable:
        note(f"{counted(known.unreadable, 'message')} below {known.prefix} could not be read")
    if plant is None:
        return _show_plants(known, as_json=json)
    if plant not in known.plants:
        names = sorted(known.plants)
        raise UsageError(f"no plant {plant!r} below {known.prefix}; {suggestion(plant, names, 'there are')}")
    return _show_drives(known.plants[plant], as_json=json)


async def _heard(settings: BrokerSettings, known: Fleet) -> None:
    from drivecomm.server.fleet import FleetSubscription

    await FleetSubscription(settings, known).known()


async def _serve(
    settings: BrokerSettings, known: Fleet, listen: str, open_database: Callable[[], Database] | None
) -> None:
    from drivecomm.server import cancel_and_wait, listen_address
    from drivecomm.server.fleet import FleetSubscription, RecordPages, fleet_page

    past = None
    if open_database is not None:
        # An unreadable record must raise its error before the page is served.
        open_database().close()
        past = RecordPages(open_database)

    listening = listen_address(TomlTable({}, "--listen"), listen, "127.0.0.1:8090").open()
    following = FleetSubscription(settings, known)
    host, port = listening.getsockname()[:2]
    place = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
    hearing = asyncio.create_task(following.run())
    try:
        await fleet_page(following, listening, lambda: say(f"fleet at {place}; stop with Ctrl-C"), past)
    finally:
        await cancel_and_wait(hearing)


def _show_plants(known: Fleet, *, as_json: bool) -> int:
    summaries = sorted((plant.summary for plant in known.plants.values()), key=lambda each: each.name)
    now = time.time()
    if as_json:
        for each in summaries:
            emit(**each._asdict())
    elif not summaries:
        say(f"no plant has published on this broker below {known.prefix}")
    else:
        print_columns([_HEAD, *(_cells(each, now) for each in summaries)])
        connected = sum(each.gateway == "online" for each in summaries)
        drives = counted(sum(each.drives for each in summaries), "drive")
        say(f"{connected} of {counted(len(summaries), 'plant')} connected, {drives}")
    if any(each.faults for each in summaries):
        return DriveError.exit_code
    wrong = not summaries or any(each.gateway != "online" or each.silent for each in summaries)
    return NoReplyError.exit_code if wrong else 0


def _cells(each: PlantSummary, now: float) -> tuple[str, ...]:
    numbers = (each.answering, each.running, each.faults, each.silent)
    live = each.gateway == "online"
    return (
        each.name,
        _GATEWAYS[each.gateway],
        str(each.drives),
        # Without its server, the state of a plant is unknown.
        *(str(number) if live else "-" for number in numbers),
        str(each.alarms),
        _age(each.read_s, now),
        each.version or "-",
        # As many digits as git shows of a commit.
        each.file_sha256[:8] or "-",
        "-" if each.file_read_s is None else f"{datetime.fromtimestamp(each.file_read_s).astimezone():%Y-%m-%d %H:%M}",
    )


def _show_drives(plant: FleetPlant, *, as_json: bool) -> int:
    from drivecomm.server.fleet import drive_content

    now, live = time.time(), plant.gateway == "online"
    if as_json:
        for drive in plant.shown:
            emit(plant=plant.name, server=plant.gateway, **drive_content(drive), drive_name=drive.name)
    else:
        print_columns([_DRIVES_HEAD, *(_drive_cells(drive, now, live=live) for drive in plant.shown)])
        if not live:
            say("its server is not connected, so the state of its drives is not known")
    if any(drive.state == "fault" for drive in plant.shown) and live:
        return DriveError.exit_code
    return 0 if live and not any(drive.answers is False for drive in plant.shown) else NoReplyError.exit_code


def _drive_cells(drive: FleetDrive, now: float, *, live: bool) -> tuple[str, ...]:
    state = "not known" if not live else "no answer" if drive.answers is False else drive.state or "not known"
    status = drive.values.get("status")
    return (
        drive.name,
        drive.model or drive.drive,
        f"{state}: {drive.fault}" if live and drive.fault else state,
        *(_value(drive, name, live=live) for name in ("output_frequency", "output_current")),
        _age(None if status is None else status.time_s, now),
    )


def _value(drive: FleetDrive, name: str, *, live: bool) -> str:
    seen = drive.values.get(name)
    fresh = live and drive.answers is not False and seen is not None and seen.quality in FRESH
    return f"{seen.value} {seen.unit}".rstrip() if fresh and seen is not None else "-"


def _age(read_s: float | None, now: float) -> str:
    return "never" if read_s is None else f"{max(0.0, now - read_s):.0f} s ago"
