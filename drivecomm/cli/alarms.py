"""Command `alarms check`: the alarms of a plant file in words, and a test message to their receivers."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import emit, say
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError, suggestion
from drivecomm.plant import read_plant
from drivecomm.server import read_settings
from drivecomm.server.alarms import read_alarms, try_out

if TYPE_CHECKING:
    from pathlib import Path


@click.command(cls=CliCommand)
@click.argument("plant", type=FILE, help="A plant file.")
@click.option("--test", metavar="NAME", help="Deliver a test message to the receivers of this alarm.")
@options.json
def check(*, plant: Path, test: str | None, json: bool) -> int:
    """Describe the alarms of a plant file in words, or test one.

    Exit code 1 if there are none, or if a receiver did not get the test message.
    """
    settings, drives = read_settings(plant), read_plant(plant).drives
    rules = {rule.name: rule for rule in read_alarms(settings.alarms, drives, settings.backups.drives)}
    if test is not None:
        if test not in rules:
            raise UsageError(f"{plant}: unknown alarm {test!r}; {suggestion(test, rules, 'it has')}")
        if not rules[test].deliver:
            raise UsageError(f"{plant}: the alarm {test!r} has no receivers; give it deliver = [...]")
        tried = try_out(rules[test], plant.stem, os.environ)
        for label, failure in tried.items():
            if json:
                emit(alarm=test, receiver=label, delivered=not failure, error=failure)
            else:
                say(f"{label}: {failure or 'delivered'}")
        return 1 if any(tried.values()) else 0
    for rule in rules.values():
        if json:
            emit(alarm=rule.name, rule=str(rule), drives=list(rule.drives), receivers=list(rule.labels))
        else:
            told = f"notifies {', '.join(rule.labels)}" if rule.labels else "no receivers"
            say(f"{rule.name}: {rule}; {told}")
    if not rules and not json:
        say(f"{plant} has no alarms; write an [[alarm]] for each")
    return 0 if rules else 1
