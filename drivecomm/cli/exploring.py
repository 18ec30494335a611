"""Progress output of commands that read everything of a drive, and their resumption after an interruption."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any

from drivecomm.bus import carry_out
from drivecomm.cli.output import complain, counted, emit, note, plain, progress_bar
from drivecomm.commissioning.exploring import Logbook, forecasting, logbook_path
from drivecomm.errors import LinkError, ReplyError
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.output import Progress as Bar
    from drivecomm.commissioning.exploring import ExplorationPlan, ExplorationStep, Progress

_EVERY_S = 10.0
"""Seconds between progress messages without a terminal."""


@contextmanager
def answer_logbook(
    of: Path, drive: Drive, way: ExplorationPlan, asked: str, line: LineArguments
) -> Iterator[tuple[Logbook, Progress]]:
    """Yield the logbook of a drive's answers and a progress display; first print the expected duration.

    of: file of the result, beside which the logbook is kept. asked: kind of request. If the block ends early, the
    answers stay and a message explains how to resume. The caller must call `over` once the result is written. Raises
    FileFormatError for a logbook with other answers.
    """
    logbook = Logbook(logbook_path(of), drive=drive.name, model=drive.model, asked=asked)
    try:
        _foretell(drive, way, logbook, line)
        with progress_bar("asking", shown=not line.json) as bar:
            yield logbook, _Shown(line, bar)
    except (LinkError, ReplyError) as error:
        if logbook.answers:
            error.args = (f"{error}; {_how_to_go_on(logbook)}", *error.args[1:])
        raise
    except KeyboardInterrupt:
        if logbook.answers:
            complain(_how_to_go_on(logbook), as_json=line.json)
        raise
    finally:
        logbook.close()


def _how_to_go_on(logbook: Logbook) -> str:
    kept = counted(len(logbook.answers), "answer")
    return f"{kept} stored in {logbook.path}; run the same command again to continue"


def _foretell(drive: Drive, way: ExplorationPlan, logbook: Logbook, line: LineArguments) -> None:
    remembered = len(logbook.answers)
    foreseen = carry_out(drive, forecasting(way, remembered=remembered))
    if line.json:
        emit(event="forecast", drive=drive.name, drive_name=drive.name,
             addresses=foreseen.addresses, remembered=remembered,
             seconds=round(foreseen.seconds, 1))  # fmt: skip
        return
    before = f", {remembered} were answered before" if remembered else ""
    note(
        f"{counted(foreseen.addresses, 'request')} to the drive, about {duration(foreseen.seconds)}{before}; Ctrl-C "
        "stops it, and the same command resumes it"
    )


def duration(seconds: float) -> str:
    """Return a duration as text for people."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{round(seconds / 60)} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


class _Shown:
    """Progress display: a bar on a terminal, otherwise a line now and then, or JSON objects for each value found."""

    def __init__(self, line: LineArguments, bar: Bar, clock: Callable[[], float] = monotonic) -> None:
        self._line = line
        self._bar = bar
        self._clock = clock
        self._begun = self._told = clock()
        self._remembered = 0

    def __call__(self, step: ExplorationStep) -> None:
        now = self._clock()
        if step.remembered:
            self._remembered += 1
            self._begun = self._told = now
        elif self._line.json and step.answer.told is not None:
            emit(event="answer", parameter=step.answer.address, **_value(step.answer.told))
        rate = (step.asked - self._remembered) / (now - self._begun) if now > self._begun else 0.0
        left_s = (step.of - step.asked) / rate if rate else None
        self._bar(f"{step.answer.address}, {step.found} found, {rate:.0f}/s", step.asked, step.of)
        if now - self._told < _EVERY_S:
            return
        self._told = now
        if self._line.json:
            emit(event="progress", asked=step.asked, of=step.of, found=step.found, per_second=round(rate, 1),
                 seconds_left=None if left_s is None else round(left_s))  # fmt: skip
        elif not sys.stderr.isatty():
            left = "" if left_s is None else f", {duration(left_s)} left"
            note(f"{step.asked} of {step.of} asked for, {step.found} found, {rate:.1f} a second{left}")


def _value(told: object) -> dict[str, Any]:
    if isinstance(told, Reading):
        return {"value": plain(told.value), "unit": told.unit, "raw": plain(told.raw), "type": told.type}
    return {"title": getattr(told, "title", "")}
