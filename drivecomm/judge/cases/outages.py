"""Cases of outages: a drive that is switched off for a while, or loses power between two telegrams."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.judge.cases.value_checks import OBSERVED_S, check_values, set_test_values, shown_by, shows_nothing
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import NotTried, fail

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.judge.stand import JudgeLine
    from drivecomm.judge.trial import CaseContext

_OFF_S = 2.5
_SHORT_S = 0.3


@case("off-on", "read", "run", title="the drive is off for a while, and comes back")
def off_on(trial: CaseContext) -> str:
    """The master works again when the drive is back; a continuous master needs no restart."""
    if trial.goes_on:
        return _off_on_while_it_runs(trial)
    with trial.stand(set_test_values(trial)) as stand:
        stand.power(on=False)
        run = trial.run(stand)
        shows_nothing(trial, run, "the drive is off")
        stand.power(on=True)
        run = trial.run(stand)
        heard = len(stand.drive.since())
    if not heard:
        fail("it sent no more requests after the drive had been off")
    if trial.learned.displays and not shown_by(trial, run):
        fail("it showed no more values after the drive had been off, though the drive answered")
    return check_values(trial, run, "the drive had been off", now_held_by=stand)


def _off_on_while_it_runs(trial: CaseContext) -> str:
    back: list[float] = []
    with trial.stand(set_test_values(trial)) as stand:

        def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
            if not back and len(stand.drive.heard) >= 2:
                back.append(stand.line.time + _OFF_S)
                stand.later(0.0, lambda: stand.line.power_off(stand.drive))
                stand.later(_OFF_S, lambda: stand.line.power_on(stand.drive))
            return [(0.0, data)]

        stand.meddler.on_reply = meddle
        run = trial.run(stand, until=lambda: bool(back) and _goes_on(stand, back[0]), within_s=trial.order.limit_s)
        asked = [each for each in stand.drive.since() if back and each.time_s > back[0]]
    if not back:
        raise NotTried("its requests are too rare to switch the drive off between two of them")
    if run.code is not None:
        fail(f"it gave up: it ended with exit code {run.code} after the drive had been off for {_OFF_S:g} s")
    if not asked:
        fail(f"it gave up: it sent no more requests after the drive had been off for {_OFF_S:g} s")
    if trial.learned.displays and not any(each.time_s > back[0] for _, each in shown_by(trial, run)):
        fail(f"it showed no more values after the drive had been off for {_OFF_S:g} s, though the drive answered")
    return "it resumed by itself"


def _goes_on(stand: JudgeLine, back_s: float) -> bool:
    """Whether the master has resumed its requests, or has been watched long enough."""
    last = [each for each in stand.drive.since() if each.time_s > back_s]
    return len(last) >= 4 or stand.now() > back_s + OBSERVED_S + _OFF_S


@case("power-cycle", "read", title="the drive loses power for a moment, between a request and its reply")
def power_cycle(trial: CaseContext) -> str:
    """The master shows the drive's value or an error, and starts no motor."""
    cut: list[float] = []
    with trial.stand(set_test_values(trial)) as stand:

        def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
            if cut:
                return [(0.0, data)]
            cut.append(stand.line.time)
            stand.later(0.0, lambda: stand.line.power_off(stand.drive))
            stand.later(_SHORT_S, lambda: stand.line.power_on(stand.drive))
            return []

        stand.meddler.on_reply = meddle
        run = trial.run(stand, within_s=OBSERVED_S if trial.goes_on else None)
        heard = stand.drive.since()
    if any(each.started for each in heard):
        fail("it started the motor after the drive had lost its power, although its task was only to read")
    return check_values(trial, run, "the drive lost its power for a moment", now_held_by=stand)
