"""The poll command: parameters with periods, on one or many lines, as lines for people or objects for scripts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.logging_option import Log, opened_log
from drivecomm.cli.output import emit, say
from drivecomm.cli.plan_words import Period, PlanFile, Words, given_plan
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.polling import poll as carry_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.bus import Bus
    from drivecomm.polling import PollItem, PollResult


def poll(
    line: LineOptions,
    words: Words = None,
    plan: PlanFile = None,
    period: Period = None,
    duration: Annotated[float | None, typer.Option("--for", metavar="SECONDS", help="End after this time.")] = None,
    cycles: Annotated[int | None, typer.Option("--cycles", help="End when each was asked this many times.")] = None,
    log: Log = None,
) -> int:
    """Read parameters periodically, until Ctrl-C unless told otherwise; a failed read is shown and the others go on.

    Exit code 0 when each was read at least once, otherwise that of the first one that never was; 1 when values are
    missing in the log because there was no room for them.
    """
    chosen, line = given_plan(words or [], plan, line, period_s=period)
    show = _emit if line.json else _say
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
def _opened(line: LineOptions, ports: Sequence[str]) -> Iterator[dict[str, Bus]]:
    """Open all lines of a plan for the time of the block. Raises LinkError for the first that cannot be opened."""
    if "" in ports:
        raise UsageError("some drives have no port: give --port, or write port in the [[line]] of the plant")
    if line.record is not None and len(ports) > 1:
        raise UsageError(f"--record is for one line, and this plan has several; poll {ports[0]} by itself")
    with ExitStack() as stack:
        try:
            yield {port: stack.enter_context(line.at(port).bus()) for port in ports}
        except DriveCommError:
            # Leaving the lines by this error would put the names of all of them in front of it.
            stack.close()
            raise


def _emit(result: PollResult) -> None:
    reading = result.reading
    emit(
        drive=result.drive,
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
        time_s=result.time_s,
        cause=result.cause,
        kind="" if result.error is None else type(result.error).__name__,
        due_s=round(result.due_s, 6),
        late_s=round(result.late_s, 6),
        took_s=round(result.took_s, 6),
        missed=result.missed,
    )


def _say(result: PollResult) -> None:
    clock = datetime.fromtimestamp(result.time_s, tz=UTC).astimezone().strftime("%H:%M:%S.%f")[:-3]
    reading = result.reading
    parameter = result.parameter if reading is None else f"{reading.parameter} {reading.name}".rstrip()
    value = "-" if reading is None else str(reading)
    why = result.cause or ("" if reading is None else reading.note)
    say(f"{clock}  {result.drive}  {parameter:<34} {value:>14}  {result.quality}{': ' if why else ''}{why}")
