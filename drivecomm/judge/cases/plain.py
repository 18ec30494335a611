"""Undisturbed case: the task must work, and its behaviour is the reference for all other cases."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.judge.cases.value_checks import must_end
from drivecomm.judge.catalogue import case
from drivecomm.judge.learned_behaviour import LearnedBehaviour, reported_outcome
from drivecomm.judge.shown_values import displays_of, learned_display
from drivecomm.judge.verdicts import fail

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.judge.judged_drive import JudgedDrive, ObservedRequest
    from drivecomm.judge.process import Run
    from drivecomm.judge.shown_values import Display
    from drivecomm.judge.trial import CaseContext

_MOST_PARAMETERS = 12


@case("plain", "read", "write", "start", "stop", "reset", "run", title="nothing is disturbed")
def plain(trial: CaseContext) -> str:
    """The task has its effect, and the master shows the drive's value."""
    return learned_from(trial)[1]


def learned_from(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    """Run a task on undisturbed lines; return its behaviour, and a sentence on its success. Raises CaseFailure."""
    return {
        "read": _read,
        "write": _write,
        "start": _start,
        "stop": _stop,
        "reset": _reset,
        "run": _run,
    }[trial.task.name](trial)


def _run_once(trial: CaseContext, prepare: Sequence[object] = ()) -> tuple[Run, list[ObservedRequest], JudgedDrive]:
    def prepared(drive: JudgedDrive) -> None:
        for each in prepare:
            each(drive)  # type: ignore[operator]

    with trial.stand(prepared) as stand:
        run = trial.run(stand)
        heard = stand.drive.since()
        damaged, broken = stand.drive.damaged, [str(each) for each in stand.violations]
    if not heard and broken:
        fail(f"the drive received no telegram addressed to it: {broken[0]}")
    if not heard:
        said = f": it says {run.text.strip().splitlines()[-1]!r}" if run.text.strip() else ""
        came = f"{damaged} damaged ones came" if damaged else "none came"
        fail(
            f"the drive received no telegram addressed to it, {came}{said}; check port, address and line settings, "
            f"which are {trial.known.facts.settings}"
        )
    must_end(trial, run)
    return run, heard, stand.drive


def _learned(run: Run, heard: Sequence[ObservedRequest], **further: object) -> LearnedBehaviour:
    return LearnedBehaviour(
        goes_on=run.code is None,
        success_output=reported_outcome(run),
        keys=Counter(each.key for each in heard),
        **further,  # type: ignore[arg-type]
    )


def _read(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    run, heard, _ = _run_once(trial)
    parameters = _parameters(trial, heard)
    raws: dict[str, tuple[int, ...]] = {}
    for parameter in parameters:
        # Each parameter gets unique values, so that a mix-up shows.
        raws[parameter] = trial.known.two_values(parameter, {raw for values in raws.values() for raw in values})
    changing = {parameter: values for parameter, values in raws.items() if len(values) == 2}
    displays = _displays_of_changing(trial, changing) if changing else _displays_of_steady(trial, run, parameters)
    learned = _learned(
        run, heard, displays=displays, raws={each: changing[each] for each in displays if each in changing}
    )
    if not displays and trial.task.name == "read":
        shown = _last_line(run)
        fail(
            f"it does not show what the drive holds: it reads {', '.join(parameters) or 'no parameter of the model'}, "
            f"and its last line is {shown!r}; if that is right, write shows, parameter and scale of the task"
        )
    if not displays:
        return learned, "it sends requests, and what it shows is not checked"
    return learned, f"it shows {', '.join(displays)} as the drive holds {'it' if len(displays) == 1 else 'them'}"


def _displays_of_changing(trial: CaseContext, raws: Mapping[str, tuple[int, ...]]) -> dict[str, Display]:
    runs = []
    for number in range(2):

        def prepare(drive: JudgedDrive, number: int = number) -> None:
            for parameter, values in raws.items():
                drive.poke(parameter, values[number])

        runs.append(_run_once(trial, [prepare])[0])
    found = {}
    for parameter, values in raws.items():
        held = [trial.known.physical(parameter, raw) for raw in values]
        numbers = [Decimal(each) for each in held if isinstance(each, Decimal | int)]
        if len(numbers) == len(runs) and (display := _display(trial, runs, numbers, values)):
            found[parameter] = display
    return found


def _displays_of_steady(trial: CaseContext, run: Run, parameters: Sequence[str]) -> dict[str, Display]:
    """Return the displays of parameters that cannot be set, such as measured values."""
    found = {}
    for parameter in parameters:
        spare = trial.known.fresh()
        value, raw = trial.known.read(spare, parameter), trial.known.holds(spare, parameter, 0.0)
        if not isinstance(value, Decimal | int):
            continue
        number = Decimal(value)
        raws = [raw if isinstance(raw, int) else int(number)] * 2
        if display := _display(trial, [run, run], [number, number], raws):
            found[parameter] = display
    return found


def _display(
    trial: CaseContext, runs: Sequence[Run], physical: Sequence[Decimal], raw: Sequence[int]
) -> Display | None:
    """Return the display of a parameter: from the task's own expression, or else learned from the runs."""
    scale = Decimal(str(trial.task.scale)) if trial.task.scale else None
    for display in displays_of(trial.task.shows, scale) if trial.task.shows else ():
        held = raw if display.is_raw else physical
        shown = [display.all_in(run) for run in runs]
        if all(shown) and all(display.shows(each, held[number]) for number in range(2) for each in shown[number]):
            return display
    return learned_display(runs, physical, raw, scale)


def _parameters(trial: CaseContext, heard: Sequence[ObservedRequest]) -> list[str]:
    """Return the addresses of the parameters read: those named in the task, or else found from the requests."""
    known, model = trial.known, trial.known.model
    if trial.task.parameter:
        info = model.find(trial.task.parameter)
        return [info.address if info else trial.task.parameter]
    words = [word for argument in trial.task.arguments for word in argument.replace("=", " ").replace(",", " ").split()]
    named = [info.address for word in words if (info := model.find(word) or model.find(model.quantities.get(word, "")))]
    asked = {each.key: each.find for each in heard if not known.is_write(each.find)}
    told = [parameter for find in asked.values() for parameter in known.parameters_read_by(find)]
    both = [each for each in named if each in told]
    if both:
        return list(dict.fromkeys(both))
    if told:
        return list(dict.fromkeys(told))[:_MOST_PARAMETERS]
    return [each for each in dict.fromkeys([*named, *model.parameters]) if any(known.reads(key, each) for key in asked)]


def _last_line(run: Run) -> str:
    lines = [line.text for line in run.lines if line.text.strip()]
    return lines[-1] if lines else ""


def _write(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    run, heard, drive = _run_once(trial)
    written = [(each, trial.known.parameter_written_by(each.find)) for each in heard]
    found = list(dict.fromkeys(parameter for _, parameter in written if parameter))
    if trial.task.parameter:
        info = trial.known.model.find(trial.task.parameter)
        found = [info.address if info else trial.task.parameter]
    if not found:
        fail(f"it writes no parameter that the model knows; its last line is {_last_line(run)!r}")
    words = " ".join(trial.task.arguments)
    parameter = next((each for each in found if each in words), found[-1])
    try:
        drive.peek(parameter, 0.0)
    except DriveCommError as error:
        fail(f"it writes {parameter}, which the drive does not hold: {error}")
    return _learned(run, heard, written=parameter), f"it writes {parameter}"


def _start(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    run, heard, _ = _run_once(trial, [trial.known.set_ready])
    starts = tuple(each for each in heard if each.started)
    if not starts:
        fail(f"the motor does not run after it; its last line is {_last_line(run)!r}")
    return _learned(run, heard, starts=starts), "the motor runs"


def _stop(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    run, heard, _ = _run_once(trial, [trial.known.set_running])
    stops = tuple(each for each in heard if each.stopped)
    if not stops:
        fail(f"the motor keeps running after it; its last line is {_last_line(run)!r}")
    return _learned(run, heard, stops=stops), "the motor stops"


def _reset(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    run, heard, drive = _run_once(trial, [trial.known.set_tripped])
    if drive.motor.fault:
        fail(f"the fault is still there after it; its last line is {_last_line(run)!r}")
    if any(each.started for each in heard):
        fail("it makes the motor run, although its task was only to reset a fault")
    return _learned(run, heard), "the fault is gone, and the motor stands"


def _run(trial: CaseContext) -> tuple[LearnedBehaviour, str]:
    learned, reason = _read(trial)
    with trial.stand(trial.known.set_ready) as stand:
        trial.run(stand)
        heard = stand.drive.since()
    starts, stops = (tuple(each for each in heard if getattr(each, name)) for name in ("started", "stopped"))
    return replace(learned, starts=starts, stops=stops), reason
