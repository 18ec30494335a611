"""Commands `fleet history` and `fleet alarms`: contents of a record of many plants."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.fleet_options import record_option
from drivecomm.cli.output import emit, say
from drivecomm.cli.time_ranges import clock, last_option, time_range
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.cli.time_ranges import TimeRange

_MOST = 100_000
_since_option = click.option("--since", "begin", metavar="TIME", help='Start time, such as "2026-11-22 10:00".')
_until_option = click.option("--until", "end", metavar="TIME", help="End time.")
_insecure_option = click.option("--insecure", is_flag=True, help="Allow a database on another machine without TLS.")


@click.command(cls=CliCommand)
@click.argument("plant", help="Its name, as fleet shows it.")
@click.argument("drive", required=False, help="Its name in the plant.")
@click.argument(
    "quantities", metavar="[QUANTITY...]", nargs=-1, help="Only these quantities, such as output_frequency."
)
@record_option
@click.option("--events", is_flag=True, help="Show what happened: faults, silence, commands.")
@click.option("--commands", is_flag=True, help="Show commands, their senders and their results.")
@_since_option
@_until_option
@last_option
@_insecure_option
@options.json
def history(
    *,
    plant: str,
    drive: str | None,
    quantities: tuple[str, ...],
    record: str,
    events: bool,
    commands: bool,
    begin: str | None,
    end: str | None,
    last: str | None,
    insecure: bool,
    json: bool,
) -> int:
    """Show values, events or commands of a plant from the record of its fleet; the last hour unless a time is given."""
    if events and commands:
        raise UsageError("--events and --commands exclude each other; give one of them")
    if drive is None and not (events or commands):
        raise UsageError("values belong to a drive; name one, or give --events or --commands")
    from drivecomm.server.record import RecordQueries, TimePeriod, open_record

    when = _when(begin, end, last)
    stretch = TimePeriod(when.from_s, when.to_s)
    with closing(open_record(record, insecure=insecure)) as database:
        past = RecordQueries(database)
        if events or commands:
            ask = past.events if events else past.commands
            for each in ask(plant, drive or "", stretch, _MOST):
                _show(each, _event_words(each) if events else _command_words(each), as_json=json)
        else:
            for value in past.values(plant, drive or "", quantities, stretch, _MOST):
                said = value._asdict()
                shown = f"{value.value} {value.unit}".rstrip() if value.value is not None else value.quality
                words = f"{value.drive}  {value.quantity}  {shown}" + f"  ({value.text or value.note})" * bool(
                    value.text or value.note
                )
                _show(said, words, as_json=json)
    return 0


@click.command(cls=CliCommand)
@click.argument("plant", required=False, help="Only this plant. Default: all plants.")
@record_option
@_since_option
@_until_option
@last_option
@_insecure_option
@options.json
def alarms(
    *,
    plant: str | None,
    record: str,
    begin: str | None,
    end: str | None,
    last: str | None,
    insecure: bool,
    json: bool,
) -> int:
    """Show the alarms of all plants from the record of their fleet: standing alarms, and those of a time range.

    Exit code 5 if a standing alarm is not acknowledged.
    """
    from drivecomm.errors import DriveError
    from drivecomm.server.record import RecordQueries, TimePeriod, open_record

    when = _when(begin, end, last)
    with closing(open_record(record, insecure=insecure)) as database:
        found = RecordQueries(database).alarms(plant or "", TimePeriod(None, when.to_s), _MOST)
    shown = [each for each in found if each["ended_s"] is None or when.has(each["since_s"])]
    for each in shown:
        _show({**each, "time_s": each["since_s"]}, _alarm_words(each), as_json=json)
    if not shown and not json:
        say("no alarms")
    stands = any(each["ended_s"] is None and not each["acknowledged_by"] for each in shown)
    return DriveError.exit_code if stands else 0


def _when(begin: str | None, end: str | None, last: str | None) -> TimeRange:
    return time_range(begin, end, last, otherwise="1h", flags=("--since", "--until"))


def _show(content: Mapping[str, Any], words: str, *, as_json: bool) -> None:
    if as_json:
        emit(**content)
    else:
        say(f"{clock(content['time_s'])}  {words}")


def _event_words(event: Mapping[str, Any]) -> str:
    about = " ".join(part for part in (event["line"], event["drive"]) if part)
    by = f", by {event['who']}" if event["who"] else ""
    return f"{about}{': ' if about else ''}{event['kind']}: {event['text']}{by}"


def _command_words(command: Mapping[str, Any]) -> str:
    why = f": {command['text']}" if command["text"] else ""
    given = "" if command["arguments"] == "{}" else f" {command['arguments']}"
    return f"{command['drive']}  {command['verb']}{given}  {command['outcome']}{why}, by {command['who']}"


def _alarm_words(alarm: Mapping[str, Any]) -> str:
    by = f", acknowledged by {alarm['acknowledged_by']}" if alarm["acknowledged_by"] else ""
    state = "over" if alarm["ended_s"] is not None or alarm["over_s"] is not None else "stands"
    return f"{alarm['plant']}  {alarm['id']}  {state}  {alarm['drive']}  {alarm['rule']}: {alarm['text']}{by}"
