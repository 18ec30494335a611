"""Command `judge`: a test of any master against a virtual drive, with a catalogue of faults."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, plain, print_columns, progress_bar, say
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE, NUMBER, WHOLE_NUMBER, Number
from drivecomm.errors import UsageError
from drivecomm.protocol import parse_drive
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.judge import Judge, JudgeCase, JudgeOrder, JudgeReport, Verdict

_MOST_LINES = 24
"""Limit of printed lines of output and telegrams of a case; the report files have all of them."""

_AT_LEAST_ONE = Number(int, "a whole number", at_least=1)


@click.command(cls=CliCommand)
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
    help="Regular expression that finds a read's value, in a group named value.",
)
@click.option(
    "--parameter",
    metavar="PARAM",
    show_default=False,
    default="",
    help="The parameter that is read, if it cannot be inferred.",
)
@click.option(
    "--listen",
    "-l",
    metavar="PLACE",
    show_default=False,
    default="",
    help="pty (default), tcp or rfc2217, or an address as for simulate.",
)
@click.option("--limit", type=NUMBER, metavar="SECONDS", default=None, help="Time limit of one process. Default: 15.")
@click.option("--manual", is_flag=True, help="Judge a master that is already running, with prompts for each step.")
@click.option("--case", "-c", "names", metavar="NAME", multiple=True, help="Only this case; repeatable.")
@click.option("--list", "listed", is_flag=True, help="List the cases and play none.")
@click.option("--seed", type=WHOLE_NUMBER, metavar="N", default=None, help="Seed of noise and damage. Default: 0.")
@click.option("--jobs", type=_AT_LEAST_ONE, metavar="N", default=3, help="Number of cases played in parallel.")
@click.option("--junit", type=FILE, help="Write the verdicts as JUnit XML too.")
@click.option("--json", "json_file", type=FILE, help="Write the report as JSON too.")
@click.option("--html", type=FILE, help="Write the report as a page too.")
@force_option
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
    manual: bool,
    names: tuple[str, ...],
    listed: bool,
    seed: int | None,
    jobs: int,
    verbose: bool,
    junit: Path | None,
    json_file: Path | None,
    html: Path | None,
    force: bool,
) -> int:
    """Judge a master: run any program against a virtual drive through a catalogue of faults.

    Give an order file, or --drive, --task and the command behind --, with {port} where the port of the master belongs.
    Exit code 1 when a case fails.
    """
    from drivecomm.judge import Judge, KnownDrive, ManualMaster, catalogue

    changed: dict[str, Any] = {"listen": listen or None, "limit_s": limit, "seed": seed}
    order = _order(words, drive, tasks, shows, parameter)
    order = replace(order, **{key: value for key, value in changed.items() if value is not None})
    if listed:
        cases = catalogue(KnownDrive(order.drive), order)
        print_columns((each.name, each.title, each.passes) for each in cases)
        return 0
    files = {"--junit": junit, "--json": json_file, "--html": html}
    _must_be_free(files, force=force)
    if manual:
        if order.command:
            raise UsageError("--manual is for a master that is already running; leave the command out")
        with ManualMaster(order, _ask) as master:
            report = _judged(Judge(order, master, names), jobs, verbose=verbose)
    else:
        report = _judged(Judge(order, names=names), jobs, verbose=verbose)
    _write(report, files)
    return 0 if report.ok else 1


def _announce(case: JudgeCase) -> None:
    say(f"{case.name}: {case.title}")


def _ask(text: str) -> str:
    """Print an instruction for the user, and return the reply."""
    say(text)
    try:
        return input("> ")
    except EOFError:
        raise UsageError("no input: --manual needs a user at the keyboard") from None


def _must_be_free(files: Mapping[str, Path | None], *, force: bool) -> None:
    named = {option: path for option, path in files.items() if path is not None}
    if force and not named:
        must_be_free(None, ", ".join(files), force=True)
    for option, path in named.items():
        must_be_free(path, option, force=force)


def _write(report: JudgeReport, files: Mapping[str, Path | None]) -> None:
    from drivecomm.judge import as_data, junit, page

    made = {"--junit": junit, "--json": lambda each: json.dumps(plain(as_data(each)), indent=1) + "\n", "--html": page}
    for option, path in files.items():
        if path is not None:
            write_atomically(path, made[option](report))


def _judged(judge: Judge, jobs: int, *, verbose: bool) -> JudgeReport:
    verdicts: list[Verdict] = []
    printed = _Printed()
    began = time.monotonic()
    with progress_bar("judging", shown=judge.runs_alone) as progress:
        for verdict in judge.verdicts(jobs, (lambda _: None) if judge.runs_alone else _announce):
            verdicts.append(verdict)
            progress(verdict.case, len(verdicts), len(judge.cases))
            printed.add(verdict, verbose=verbose)
    printed.flush()
    report = judge.report(verdicts, time.monotonic() - began)
    say()
    say("; ".join(map(str, report.coverage)))
    say(f"{report.drive}, model {report.model}, seed {report.seed}: {report.summary()}, {report.seconds:.1f} s")
    return report


class _Printed:
    """Printer of verdicts; consecutive cases that were not tried for the same reason share a line."""

    def __init__(self) -> None:
        self._waiting: list[Verdict] = []

    def add(self, verdict: Verdict, *, verbose: bool) -> None:
        """Print a verdict, or hold it back until a different one follows."""
        if self._waiting and (verdict.outcome, verdict.reason) != ("not tried", self._waiting[0].reason):
            self.flush()
        if verdict.outcome == "not tried":
            self._waiting.append(verdict)
        else:
            _say(verdict, verbose=verbose)

    def flush(self) -> None:
        """Print the verdicts that were held back."""
        if self._waiting:
            first, more = self._waiting[0], len(self._waiting) - 1
            names = first.case + (f" and {counted(more, 'more case')}" if more else "")
            say(f"not tried  {names}: {first.reason}")
        self._waiting.clear()


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


def _order(words: tuple[str, ...], drive: str, tasks: tuple[str, ...], shows: str, parameter: str) -> JudgeOrder:
    from drivecomm.judge import JudgeOrder, JudgeTask, parse_task, read_order

    if not drive:
        if not words:
            raise UsageError("nothing to judge; name an order file, or a --drive, and the command behind --")
        order = read_order(Path(words[0]))
        order = replace(order, command=words[1:] or order.command)
        given = [parse_task(text) for text in tasks]
        return replace(order, tasks=tuple(given)) if given else order
    made = (parse_task(text) for text in tasks)
    told = [replace(each, shows=shows, parameter=parameter) if each.name in ("read", "run") else each for each in made]
    run = JudgeTask(name="run", shows=shows, parameter=parameter)
    return JudgeOrder(drive=parse_drive(drive), command=words, tasks=tuple(told) or (run,))
