"""Command `models draw`: random facts of the packaged models, for checks against their pages."""

from __future__ import annotations

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import emit, say
from drivecomm.models import sample_facts as drawn


@click.command(cls=CliCommand)
@click.option("--seed", type=int, required=True, help="The same number draws the same facts.")
@click.option("--count", type=click.IntRange(min=1), default=100, show_default=True, help="Number of facts.")
@options.json
def draw(*, seed: int, count: int, json: bool) -> int:
    """Draw facts at random, each with its source page or program.

    To check the packaged models, open the page, and compare number, scale, unit and texts.
    """
    facts = drawn(seed, count)
    for fact in facts:
        if json:
            emit(**fact._asdict())
            continue
        rests = f"  behind {', '.join(fact.behind)}" if fact.behind else ""
        say(f"{fact.model}  {fact.address} {fact.name}: {fact.says}")
        say(f"  {fact.sure}: {' | '.join(each for each in (fact.source, fact.second_source) if each)}{rests}")
    without = [fact for fact in facts if not fact.has_page]
    resting = sum(bool(fact.behind) for fact in without)
    if json:
        emit(seed=seed, facts=len(facts), without_a_page=len(without), of_these_behind_something=resting)
    else:
        say(
            f"{len(facts)} facts drawn with seed {seed}: {len(without)} without a page or a program, "
            f"{resting} of them behind a common name, a command or the watchdog"
        )
    return 0
