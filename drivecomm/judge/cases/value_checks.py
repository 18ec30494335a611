"""Helpers shared by the cases: checks of shown values, and texts for the behaviour of a master."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.judge.verdicts import NotTried, fail

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.judge.judged_drive import JudgedDrive
    from drivecomm.judge.process import Run
    from drivecomm.judge.shown_values import Shown
    from drivecomm.judge.stand import JudgeLine
    from drivecomm.judge.trial import CaseContext

OBSERVED_S = 4.0
"""How long a continuous master is watched before it is ended, in seconds."""


def set_test_values(trial: CaseContext, number: int = 0) -> Callable[[JudgedDrive], None]:
    """Return a function that sets a drive to the first or second of the two test values of each parameter read."""
    raws = {parameter: values[number] for parameter, values in trial.learned.raws.items() if len(values) > number}

    def prepare(drive: JudgedDrive) -> None:
        for parameter, raw in raws.items():
            drive.poke(parameter, raw)

    return prepare


def must_end(trial: CaseContext, run: Run) -> None:
    """Fail if a master that normally ends by itself reached its time limit."""
    if run.too_long:
        fail(f"it did not end by itself within {trial.order.limit_s:g} s")


def right_value(trial: CaseContext, parameter: str, number: int) -> Decimal | None:
    """Return the right display, physical or raw, of a parameter's test value with this number; None if unknown."""
    raws = trial.learned.raws.get(parameter, ())
    if len(raws) > number:
        return _as_shown(trial, parameter, raws[number])
    return None if number else _as_shown(trial, parameter, trial.known.holds(trial.known.fresh(), parameter, 0.0))


def _as_shown(trial: CaseContext, parameter: str, raw: int | str) -> Decimal | None:
    if trial.learned.displays[parameter].is_raw and isinstance(raw, int):
        return Decimal(raw)
    value = trial.known.physical(parameter, raw)
    if value is None:
        value = trial.known.read(trial.known.fresh(), parameter)
    return Decimal(value) if isinstance(value, Decimal | int) else None


def shown_by(trial: CaseContext, run: Run) -> list[tuple[str, Shown]]:
    """Return all values that a run showed, with their parameters, ordered by time."""
    found = [(parameter, each) for parameter, display in trial.learned.displays.items() for each in display.all_in(run)]
    return sorted(found, key=lambda each: each[1].time_s)


def check_values(
    trial: CaseContext, run: Run, why: str, *, numbers: Sequence[int] = (0,), now_held_by: JudgeLine | None = None
) -> str:
    """Fail if a run shows a value that the drive does not hold; return a sentence on the values shown.

    why: the disturbance of the telegrams, as the end of the sentence. numbers: which of the two test values are right.
    now_held_by: a line whose drive may have lost the value; the drive's present value is right as well.
    """
    shown = shown_by(trial, run)
    displays: Mapping[str, object] = trial.learned.displays
    for parameter, each in shown:
        right = [value for number in numbers if (value := right_value(trial, parameter, number)) is not None]
        if now_held_by is not None:
            right += _held_now(trial, now_held_by, parameter)
        display = trial.learned.displays[parameter]
        if right and not any(display.shows(each, value) for value in right):
            held = " or ".join(f"{value}" for value in right)
            fail(f"it accepted a wrong value: it shows {each.text}, and {parameter} of the drive is {held}; {why}")
    must_end(trial, run)
    if shown:
        return f"it showed {shown[-1][1].text}, which the drive holds"
    if not displays:
        return "it ended, and what it showed was not checked"
    return "it showed an error" if run.text.strip() or run.code else "it showed nothing"


def _held_now(trial: CaseContext, stand: JudgeLine, parameter: str) -> list[Decimal]:
    value = _as_shown(trial, parameter, trial.known.holds(stand.drive, parameter, stand.now()))
    return [] if value is None else [value]


def shows_nothing(trial: CaseContext, run: Run, why: str) -> str:
    """Fail if a run shows any value; return a sentence on its behaviour."""
    shown = shown_by(trial, run)
    if shown:
        fail(f"it accepted a wrong value: it shows {shown[0][1].text}; {why}")
    must_end(trial, run)
    return "it showed an error" if run.text.strip() or run.code else "it showed nothing"


def needs_values(trial: CaseContext) -> None:
    """Raise NotTried if no value that the master shows is known."""
    if not trial.learned.displays:
        raise NotTried("nothing that the master shows is known to be a value of the drive; write shows and parameter")


def watch_time_s(trial: CaseContext) -> float | None:
    """Return how long a continuous master is watched, or None if the order's time limit applies."""
    return OBSERVED_S if trial.goes_on else None
