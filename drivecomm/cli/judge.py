"""The judge command: a master of any make against a virtual drive, through a catalogue of what goes wrong."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.commands import Command
from drivecomm.cli.output import print_columns, progress_bar, say
from drivecomm.cli.values import NUMBER, WHOLE_NUMBER, Number
from drivecomm.errors import UsageError
from drivecomm.protocol import parse_drive

if TYPE_CHECKING:
    from drivecomm.judge import Judge, Order, Verdict

_MOST_LINES = 24
"""Of the output and of the telegrams of a case on the terminal; the reports have more."""

_AT_LEAST_ONE = Number(int, "a whole number", at_least=1)


@click.command(cls=Command)
@click.argument(
    "words",
    metavar="[FILE] [-- COMMAND...]",
    nargs=-1,
    type=click.UNPROCESSED,
    help="An order, or the command line of the master.",
)
@click.option(
    "--drive",
    "-d",
    metavar="DRIVE",
    show_default=False,
    default="",
    help="PROTOCOL:ADDRESS[,model=...], instead of a file.",
)
@click.option(
    "--task",
    "-t",
    "tasks",
    metavar="TASK[=ARGUMENTS]",
    multiple=True,
    help="read, write, start, stop, reset or run; repeatable.",
)
@click.option(
    "--shows",
    metavar="REGEX",
    show_default=False,
    default="",
    help="Where a read shows its value, in a group named value.",
)
@click.option(
    "--parameter", metavar="PARAM", show_default=False, default="", help="What is read, if it cannot be learned."
)
@click.option(
    "--listen",
    "-l",
    metavar="PLACE",
    show_default=False,
    default="",
    help="pty (default), tcp or rfc2217, or a place as simulate has it.",
)
@click.option(
    "--limit", type=NUMBER, metavar="SECONDS", default=None, help="How long one process may take; 15 unless given."
)
@click.option("--case", "-c", "names", metavar="NAME", multiple=True, help="Only this case; repeatable.")
@click.option("--list", "listed", is_flag=True, help="List the cases and play none.")
@click.option(
    "--seed", type=WHOLE_NUMBER, metavar="N", default=None, help="Another course of noise and damage; 0 unless given."
)
@click.option("--jobs", type=_AT_LEAST_ONE, metavar="N", default=3, help="How many cases are played at a time.")
@click.option("--verbose", "-v", is_flag=True, help="Print the telegrams of cases that passed, too.")
def judge(
    *,
    words: tuple[str, ...],
    drive: str,
    tasks: tuple[str, ...],
    shows: str,
    parameter: str,
    listen: str,
    limit: float | None,
    names: tuple[str, ...],
    listed: bool,
    seed: int | None,
    jobs: int,
    verbose: bool,
) -> int:
    """Judge a master: any program that talks to a drive. Exit code 1 when a case fails."""
    from drivecomm.judge import Judge, KnownDrive, catalogue

    changed: dict[str, Any] = {"listen": listen or None, "limit_s": limit, "seed": seed}
    order = _order(words, drive, tasks, shows, parameter)
    order = replace(order, **{key: value for key, value in changed.items() if value is not None})
    if listed:
        cases = catalogue(KnownDrive(order.drive), order)
        print_columns((each.name, each.title, each.passes) for each in cases)
        return 0
    found = Judge(order, names=names)
    return _judge(found, jobs, verbose=verbose)


def _judge(judge: Judge, jobs: int, *, verbose: bool) -> int:
    verdicts: list[Verdict] = []
    with progress_bar("judging", shown=True) as progress:
        for verdict in judge.verdicts(jobs):
            verdicts.append(verdict)
            progress(verdict.case, len(verdicts), len(judge.cases))
            _say(verdict, verbose=verbose)
    counts = Counter(each.outcome for each in verdicts)
    say()
    say("; ".join(map(str, judge.coverage.summary())))
    say(
        f"{judge.order.drive}, model {judge.known.model.name}, seed {judge.order.seed}: {counts['passed']} passed, "
        f"{counts['failed']} failed, {counts['not tried']} not tried"
    )
    return 1 if counts["failed"] or not counts["passed"] else 0


def _say(verdict: Verdict, *, verbose: bool) -> None:
    outcome = "FAILED" if verdict.outcome == "failed" else verdict.outcome
    say(f"{outcome:<9}  {verdict.case}: {verdict.reason}")
    if verdict.outcome != "failed" and not verbose:
        return
    say(f"           what happened: {verdict.title}")
    for output in verdict.output:
        for line in output.splitlines()[-_MOST_LINES:]:
            say(f"           | {line}")
    for trace in verdict.trace:
        for line in trace.splitlines()[-_MOST_LINES:]:
            say(f"           {line}")


def _order(words: tuple[str, ...], drive: str, tasks: tuple[str, ...], shows: str, parameter: str) -> Order:
    from drivecomm.judge import Order, Task, parse_task, read_order

    if not drive:
        if not words:
            raise UsageError("nothing to judge; name an order file, or a --drive, and the command behind --")
        order = read_order(Path(words[0]))
        order = replace(order, command=words[1:] or order.command)
        given = [parse_task(text) for text in tasks]
        return replace(order, tasks=tuple(given)) if given else order
    made = (parse_task(text) for text in tasks)
    asked = {"shows": shows, "parameter": parameter}
    told = tuple(replace(each, **asked) if each.name in ("read", "run") else each for each in made)
    return Order(drive=parse_drive(drive), command=words, tasks=told or (Task(name="run", **asked),))
