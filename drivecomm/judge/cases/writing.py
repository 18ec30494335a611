"""Cases of writes: the drive must hold the requested value afterwards, and EEPROM must be spared."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.judge.cases.value_checks import must_end, watch_time_s
from drivecomm.judge.catalogue import case
from drivecomm.judge.learned_behaviour import says_success
from drivecomm.judge.order import USUAL_VALUE
from drivecomm.judge.shown_values import number_in
from drivecomm.judge.verdicts import NotTried, fail

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.judge.order import JudgeTask
    from drivecomm.judge.trial import CaseContext
    from drivecomm.protocol import ParameterInfo

_STEPS_BEYOND = 10


@case("lost", "write", title="the reply to the write never arrives")
def lost(trial: CaseContext) -> str:
    """The master reports an error."""
    known, parameter = trial.known, trial.learned.written
    with trial.stand() as stand:

        def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
            last = stand.drive.heard[-1]
            return [] if known.parameter_written_by(last.find) == parameter else [(0.0, data)]

        stand.meddler.on_reply = meddle
        run = trial.run(stand, within_s=watch_time_s(trial))
    must_end(trial, run)
    if says_success(run, trial.learned):
        fail("it treats the write as done: no reply arrived, and its output is the same as on success")
    return "it reported an error"


@case("stored", "read", "write", "start", "run", title="its writes to EEPROM are counted")
def stored(trial: CaseContext) -> str:
    """One task stores a parameter in EEPROM once or twice at most."""
    with trial.stand(trial.known.set_ready) as stand:
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    if not heard:
        raise NotTried("it sent nothing that the drive understands")
    counts = Counter(parameter for each in heard if (parameter := trial.known.parameter_stored_by(each.find)))
    limit = trial.order.stored_writes
    for parameter, times in counts.most_common(1):
        if times > limit:
            fail(
                f"it writes EEPROM in a loop: {parameter} was stored {times} times within "
                f"{run.ended_s - run.began_s:.1f} s, and {limit} are allowed; cells wear out after some 100,000 writes"
            )
    return f"{sum(counts.values())} writes to EEPROM" if counts else "it does not write to EEPROM"


@case("ends", "write", title="values at the ends of the range are written, and beyond")
def ends(trial: CaseContext) -> str:
    """The drive holds the requested value, or the master reports an error; no value is clamped."""
    parameter = trial.learned.written
    info = trial.known.model.find(parameter)
    if info is None:
        raise NotTried(f"the model does not know {parameter}, so its range is not known")
    spoken = _ValueArgument(trial, info)
    wanted = _wanted(trial, info, spoken)
    done = []
    for value in wanted:
        with trial.stand() as stand:
            before = trial.known.holds(stand.drive, parameter, 0.0)
            run = trial.run(stand, task=spoken.task_for(value), within_s=watch_time_s(trial))
            raw = trial.known.holds(stand.drive, parameter, stand.now())
            wrote = any(trial.known.parameter_written_by(each.find) == parameter for each in stand.drive.since())
        held = trial.known.physical(parameter, raw)
        must_end(trial, run)
        if held == value:
            done.append(f"{value}")
            continue
        if raw != before or (wrote and says_success(run, trial.learned)):
            fail(f"it had to write {value}, and the drive holds {held} after it: a value is clamped or cut silently")
        if says_success(run, trial.learned):
            fail(f"it had to write {value}, its output is the same as on success, and the drive still holds {held}")
    return f"the drive holds {' and '.join(done)} after them" if done else "it refuses them"


def _wanted(trial: CaseContext, info: ParameterInfo, spoken: _ValueArgument) -> list[Decimal]:
    """Return the values at both ends of the range and beyond; for an unknown range, large values."""
    step = max(info.factor, Decimal(1).scaleb(-spoken.decimals)) * _STEPS_BEYOND
    low, high = info.minimum, info.maximum
    if low is None and high is None:
        raws = (2**15 - 1, 2**16 - 1, 2**31 - 1, -1, -(2**15), -(2**31))
        return [raw * info.factor for raw in raws if trial.known.physical(info.address, raw) == raw * info.factor]
    wanted = [value for value in (high, low) if value is not None]
    if high is not None:
        wanted.append(high + step)
    if low is not None and (low < 0 or low >= step):
        wanted.append(low - step)
    return wanted


class _ValueArgument:
    """Form in which the value is given to the master on its command line."""

    def __init__(self, trial: CaseContext, info: ParameterInfo) -> None:
        self._task = trial.task
        self._factor = Decimal(1)
        self._place = -1
        self.decimals = 0
        value = self._written(trial, info)
        numbers = [(at, number_in(word)) for at, word in enumerate(trial.task.arguments) if _is_number(word)]
        if any("{value}" in word for word in trial.task.arguments):
            numbers = [(-1, Decimal(USUAL_VALUE))]
        for factor in dict.fromkeys((Decimal(1), 1 / info.factor)):
            for at, number in reversed(numbers):
                if number is not None and value is not None and number == value * factor:
                    self._place, self._factor = at, factor
                    self.decimals = len(trial.task.arguments[at].partition(".")[2]) if at >= 0 else 0
                    return
        raise NotTried("it is not clear which of its arguments is the value; write {value} in its place")

    def _written(self, trial: CaseContext, info: ParameterInfo) -> Decimal | None:
        with trial.stand() as stand:
            trial.run(stand, within_s=watch_time_s(trial))
            value = trial.known.physical(info.address, trial.known.holds(stand.drive, info.address, stand.now()))
        return Decimal(value) if isinstance(value, Decimal | int) else None

    def task_for(self, value: Decimal) -> JudgeTask:
        """Return the task that writes this value."""
        text = f"{(value * self._factor).normalize():f}"
        words: Sequence[str] = self._task.arguments
        if self._place < 0:
            return replace(self._task, arguments=tuple(word.replace("{value}", text) for word in words))
        return replace(self._task, arguments=(*words[: self._place], text, *words[self._place + 1 :]))


def _is_number(word: str) -> bool:
    try:
        Decimal(word)
    except ArithmeticError:
        return False
    return True
