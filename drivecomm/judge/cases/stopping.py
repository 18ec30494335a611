"""Cases of stops: a stop must be sent in any situation, and repeated until it is confirmed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.judge.cases.value_checks import must_end, watch_time_s
from drivecomm.judge.catalogue import case
from drivecomm.judge.judged_drive import key_of
from drivecomm.judge.verdicts import NotTried, fail

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.judge.judged_drive import ObservedRequest
    from drivecomm.judge.trial import CaseContext
    from drivecomm.protocol import Framed, VirtualReply


def _must_stop(trial: CaseContext) -> None:
    if not trial.learned.stops:
        raise NotTried("it does not stop a motor")


def _times(heard: Sequence[ObservedRequest]) -> int:
    """Return the number of times that the telegram that stopped the motor was sent."""
    stop = next((each for each in heard if each.stopped), None)
    return 0 if stop is None else [each.key for each in heard].count(stop.key)


@case("lost", "stop", title="the motor stops, and the reply to the stop is lost")
def lost(trial: CaseContext) -> str:
    """The stop is repeated, because it is not confirmed."""
    _must_stop(trial)
    lost: list[bytes] = []
    with trial.stand(trial.known.set_running) as stand:

        def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
            if lost or not any(each.stopped for each in stand.drive.since()):
                return [(0.0, data)]
            lost.append(data)
            return []

        stand.meddler.on_reply = meddle
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    if not lost:
        raise NotTried("the drive does not reply to the stop of its motor")
    if _times(heard) < 2:
        fail("it did not repeat the stop: its reply was lost, and it was sent once only")
    must_end(trial, run)
    return f"the stop was sent {_times(heard)} times"


@case("unheard", "stop", title="the first stop does not reach the drive")
def unheard(trial: CaseContext) -> str:
    """The stop is repeated, and the motor stops."""
    _must_stop(trial)
    keys = {each.key for each in trial.learned.stops}
    missed: list[Framed] = []

    def between(find: Framed, act: Callable[[], VirtualReply | None]) -> VirtualReply | None:
        if missed or key_of(find.message) not in keys:
            return act()
        missed.append(find)
        return None

    with trial.stand(trial.known.set_running) as stand:
        stand.drive.between = between
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    if not missed:
        raise NotTried("it stopped the motor with another telegram than on an undisturbed line")
    if not any(each.stopped for each in heard):
        fail("it did not repeat the stop: the first one did not reach the drive, and the motor keeps running")
    must_end(trial, run)
    return "the stop was sent again, and the motor stops"


@case("mute", "stop", title="no more replies of the drive arrive, and the motor runs")
def mute(trial: CaseContext) -> str:
    """The stop is sent despite missing replies, and repeated."""
    _must_stop(trial)
    with trial.stand(trial.known.set_running) as stand:
        stand.meddler.on_reply = lambda _: []
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    if not any(each.stopped for each in heard):
        fail("the stop never went out after a time-out: no reply of the drive arrived, and the motor keeps running")
    if _times(heard) < 2:
        fail("it did not repeat the stop: no reply arrived, and it was sent once only")
    must_end(trial, run)
    return f"the stop went out, {_times(heard)} times"
