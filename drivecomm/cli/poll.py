"""Command `poll`, and the notation of poll plans on the command line: drives, each followed by its parameters."""

from __future__ import annotations

import re
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, machine_content, say
from drivecomm.cli.value_files import log_option, opened_log
from drivecomm.cli.values import FILE, NUMBER, WHOLE_NUMBER
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.line import PollItem, PollPlan, poll as carry_out
from drivecomm.protocol import DriveConfig, installed, parse_drive, parse_options, unknown_protocol

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivecomm.bus import BlockingLine
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.line import PollResult
    from drivecomm.plant import Plant
    from drivecomm.protocol import MachineValue


words_argument = click.argument(
    "words",
    shell_complete=options.complete_drive_or_group,
    metavar="[DRIVE PARAM...]",
    nargs=-1,
    help="A drive or a group and its parameters, each with ,name=value options, @SECONDS and !PRIORITY behind it.",
)
plan_option = click.option("--plan", type=FILE, help="Plant file whose drives say what is polled.")
period_option = click.option(
    "--period", type=NUMBER, help="Seconds, for parameters without @; 1 if absent, 0 without a pause."
)

_DRIVE = re.compile(r"([^:,]+):\d+(,.*)?", re.ASCII | re.DOTALL)
_PARAMETER = re.compile(r"(?P<what>[^@!]+)(?:@(?P<period>[^@!]*))?(?:!(?P<priority>[^@!]*))?")
_NEXT_SETTING = re.compile(r",(?=[A-Za-z_-]+=)")


@click.command(cls=LineCommand)
@words_argument
@plan_option
@period_option
@click.option("--for", "duration", type=NUMBER, metavar="SECONDS", help="Stop after this time.")
@click.option("--cycles", type=WHOLE_NUMBER, help="Stop when each was read this many times.")
@log_option
def poll(
    *,
    line: LineArguments,
    words: tuple[str, ...],
    plan: Path | None,
    period: float | None,
    duration: float | None,
    cycles: int | None,
    log: Path | None,
) -> int:
    """Read parameters periodically, by default until Ctrl-C; a failed read is shown and the others continue.

    Exit code 0 if each was read at least once, otherwise the code of the first one that never was; 1 if values are
    missing in the log for lack of disk space.
    """
    chosen, line = given_plan(words, plan, line, period_s=period)
    show = _emit if line.json else _Rows().say
    unread: dict[PollItem[Any], DriveCommError | None] = {}
    with opened_log(log, as_json=line.json) as keep, _opened(line, chosen.lines) as buses:
        items = chosen.items(lambda drive: drive.build(buses[drive.line].drive))
        unread.update(dict.fromkeys(items))
        with closing(carry_out(items, duration_s=duration, cycles=cycles)) as results:
            for result in results:
                show(result)
                keep(result)
                if result.error is None:
                    unread.pop(result.item, None)
                elif result.item in unread:
                    unread[result.item] = unread[result.item] or result.error
    return next((error.exit_code for error in unread.values() if error is not None), 0)


@contextmanager
def _opened(line: LineArguments, ports: Sequence[str]) -> Iterator[dict[str, BlockingLine]]:
    """Open all lines of a plan for the time of the block. Raises LinkError for the first line that cannot be opened."""
    if "" in ports:
        raise UsageError("some drives have no port: give --port, or write port in the [[line]] of the plant")
    if line.record is not None and len(ports) > 1:
        raise UsageError(f"--record is for one line, and this plan has several; poll {ports[0]} separately")
    with ExitStack() as stack:
        try:
            yield {port: stack.enter_context(line.at(port).bus()) for port in ports}
        except DriveCommError:
            # Closed here, so that the exit of each line does not add its name to the error.
            stack.close()
            raise


def _emit(result: PollResult) -> None:
    reading = result.reading
    emit(
        drive=result.drive,
        drive_name=result.drive,
        parameter=result.parameter,
        quality=result.quality,
        value=None if reading is None else reading.value,
        unit="" if reading is None else reading.unit,
        address="" if reading is None else reading.parameter,
        name="" if reading is None else reading.name,
        raw=None if reading is None else reading.raw,
        type="" if reading is None else reading.type,
        text="" if reading is None else reading.text,
        note="" if reading is None else reading.note,
        doubt="" if reading is None else reading.doubt,
        **({} if (machine := _at_machine(result)) is None else machine_content(machine)),
        time_s=result.time_s,
        cause=result.cause,
        kind="" if result.error is None else type(result.error).__name__,
        due_s=round(result.due_s, 6),
        late_s=round(result.late_s, 6),
        took_s=round(result.took_s, 6),
        missed=result.missed,
    )


def _at_machine(result: PollResult) -> MachineValue | None:
    machine = result.item.drive.machine
    return None if machine is None or result.reading is None else machine.beside(result.reading)


class _Rows:
    """Poll results as rows; the note on a parameter appears in its first row, and again when it changes."""

    def __init__(self) -> None:
        self._notes: dict[tuple[str, str], str] = {}

    def say(self, result: PollResult) -> None:
        clock = datetime.fromtimestamp(result.time_s, tz=UTC).astimezone().strftime("%H:%M:%S.%f")[:-3]
        reading = result.reading
        parameter = result.parameter if reading is None else f"{reading.parameter} {reading.name}".rstrip()
        value = "-" if reading is None else str(reading)
        if (machine := _at_machine(result)) is not None:
            value += f" = {machine}"
        why = result.cause or self._news(result)
        say(f"{clock}  {result.drive}  {parameter:<34} {value:>14}  {result.quality}{': ' if why else ''}{why}")

    def _news(self, result: PollResult) -> str:
        key = result.drive, result.parameter
        if self._notes.get(key, "") == result.remark:
            return ""
        self._notes[key] = result.remark
        return result.remark


def given_plan(
    words: Sequence[str], plan_file: Path | None, line: LineArguments, *, period_s: float | None = None
) -> tuple[PollPlan, LineArguments]:
    """Return the poll plan of a call, and the line options for it; drives without a port use the port of the call.

    Without words, the plan is that of the plant. Options of the command line override those of single drives in a file.
    period_s: default period of parameters on the command line; None for one second. Raises UsageError.
    """
    if plan_file is not None:
        if words:
            raise UsageError("give --plan or drives and parameters, not both")
        line.refuse(f"the drives are those of {plan_file}", "plant")
        line = replace(line, plant=plan_file)
    # A first word without a colon names a drive of the plant, even if a port is given.
    begins_with_name = bool(words) and ":" not in words[0].partition(",")[0]
    known = known_plant(line.plant, port_given="port" in line.given and not begins_with_name)
    if words or known is None:
        plan = parse_plan(words, period_s=1.0 if period_s is None else period_s, known=known)
    else:
        if period_s is not None:
            raise UsageError("the plant says how often each is read, so --period has no effect; leave it out")
        plan = known.poll_plan()
    if all(drive.line for drive in plan.drives):
        line.refuse("the plan names the ports of all its drives", "port")

    port = line.port or ""
    return plan.with_drives(lambda one: replace(one, line=one.line or port).with_options(**line.said_facts)), line


def parse_plan(words: Sequence[str], *, period_s: float, known: Plant | None = None) -> PollPlan:
    """Parse a plan such as `vabus:1 481 482@0.2 fuji:7,model=g11s M09!2`. Raises UsageError.

    known: the plant, whose names and groups stand for its drives; PROTOCOL:ADDRESS is the drive of the plant at that
    address, if there is one.
    """
    drives: dict[str, tuple[DriveConfig, ...]] = {}
    chosen: tuple[DriveConfig, ...] = ()
    reads: list[PollItem[DriveConfig]] = []
    for word in words:
        if _names_drives(word, known):
            # A drive that is named again keeps its earlier options.
            chosen = drives.setdefault(word, _drives(word, known))
        elif not chosen:
            hint = f"; a file is given by --plan {word}" if word.endswith(".toml") else ""
            raise UsageError(
                f"{word!r} is not a drive; a plan begins with one: PROTOCOL:ADDRESS, such as vabus:1{hint}"
            )
        else:
            reads += [_read(word, drive, period_s) for drive in chosen]
    idle = [word for word, several in drives.items() if not any(read.drive in several for read in reads)]
    if idle:
        raise UsageError(f"no parameters given for {idle[0]}; name them after it")
    if not reads:
        raise UsageError(
            "nothing to read; name drives and parameters, such as vabus:1 481 482@0.2, or give --plan FILE"
        )
    # Groups may share drives, so duplicates are removed.
    return PollPlan(reads=tuple(dict.fromkeys(reads)))


def _names_drives(word: str, there: Plant | None) -> bool:
    if there is not None and word.partition(",")[0] in {*(drive.name for drive in there.drives), *there.groups}:
        return True
    protocol, colon, _ = word.partition(",")[0].partition(":")
    if colon and protocol in installed:
        return True
    if _DRIVE.fullmatch(word):
        raise unknown_protocol(protocol, installed)
    return False


def _drives(word: str, known: Plant | None) -> tuple[DriveConfig, ...]:
    called, *settings = word.split(",")
    if known is None or not any(called in (one.name, str(one), *one.groups) for one in known.drives):
        return (parse_drive(word),)
    options = parse_options(settings)
    return tuple(known.line(one.line).reached(one).with_options(**options) for one in known.named(called))


def _read(word: str, drive: DriveConfig, period_s: float) -> PollItem[DriveConfig]:
    match = _PARAMETER.fullmatch(word)
    if match is None:
        raise UsageError(f"{word!r} is not a parameter; write PARAM[@SECONDS][!PRIORITY], such as 481@0.2!1")
    # A comma may be part of a parameter's address; options follow as name=value.
    parameter, *settings = _NEXT_SETTING.split(match["what"])
    try:
        period = period_s if match["period"] is None else float(match["period"])
        priority = 0 if match["priority"] is None else int(match["priority"])
    except ValueError:
        raise UsageError(f"invalid period or priority in {word!r}; write PARAM@SECONDS!PRIORITY") from None
    return PollItem(
        drive=drive, parameter=parameter, period_s=period, priority=priority, options=parse_options(settings)
    )
