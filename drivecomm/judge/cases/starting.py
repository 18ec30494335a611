"""Cases of starts: a start is sent once only, because a start without a reply may have worked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.judge.cases.value_checks import must_end, watch_time_s
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import NotTried, fail
from drivecomm.protocol import MotorCommand

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.judge.judged_drive import ObservedRequest
    from drivecomm.judge.stand import JudgeLine
    from drivecomm.judge.trial import CaseContext

_OFF_S = 0.3
_WATCHED_S = 1.0
_FOR_GOOD_S = 3600.0


def _started(stand: JudgeLine) -> bool:
    return any(each.started for each in stand.drive.since())


def _once(trial: CaseContext, meddle: Callable[[JudgeLine, bytes], Sequence[tuple[float, bytes]]], what: str) -> str:
    """Disturb replies from the start on; fail if the request that starts the motor is repeated."""
    starts = trial.learned.starts
    if not starts:
        raise NotTried("it does not start a motor")
    if trial.learned.keys[starts[0].key] > 1:
        raise NotTried("it repeats the start all the time, even on an undisturbed line")
    with trial.stand(trial.known.set_ready) as stand:
        stand.meddler.on_reply = lambda data: meddle(stand, data) if _started(stand) else [(0.0, data)]
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    must_be_sent_once(heard, what)
    must_end(trial, run)
    return "the start was sent once"


def must_be_sent_once(heard: Sequence[ObservedRequest], what: str) -> None:
    """Fail if the request that starts the motor was repeated."""
    first = next((each for each in heard if each.started), None)
    if first is None:
        raise NotTried("the motor never ran")
    times = [each.key for each in heard].count(first.key)
    again = sum(each.started for each in heard)
    if times > 1 or again > 1:
        shown = first.data.hex(" ").upper()
        fail(f"it sent the start again: {shown} makes the motor run, and was sent {max(times, again)} times; {what}")


@case("start-lost", "run", title="the motor runs, and the reply to the start and all later ones are lost")
@case("lost", "start", title="the motor runs, and the reply to the start and all later ones are lost")
def lost(trial: CaseContext) -> str:
    """The request that starts the motor is sent once."""
    return _once(trial, lambda _, __: [], "its reply was lost, and the drive had obeyed")


@case("lost-once", "start", title="the motor runs, and only the reply to the start is lost")
def lost_once(trial: CaseContext) -> str:
    """The request that starts the motor is sent once."""
    lost: list[bytes] = []

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        lost.append(data)
        return [] if len(lost) == 1 else [(0.0, data)]

    return _once(trial, meddle, "its reply was lost, and the drive had obeyed")


@case("damaged", "start", title="the motor runs, and the reply to the start is damaged")
def damaged(trial: CaseContext) -> str:
    """The request that starts the motor is sent once."""
    count = [0]

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        return [(0.0, data if count[0] > 1 else data[:-1] + bytes([data[-1] ^ 0x15]))]

    return _once(trial, meddle, "its reply was damaged, and the drive had obeyed")


@case("late", "start", title="the motor runs, and the reply to the start comes late")
def late(trial: CaseContext) -> str:
    """The request that starts the motor is sent once."""
    late_s = trial.known.facts.timing.reply_timeout_s * 2 + 0.2
    return _once(trial, lambda _, data: [(late_s, data)], "its reply was late, and the drive had obeyed")


@case("power-cycle", "start", "run", title="the drive loses power when the motor runs, and gets it back")
def power_cycle(trial: CaseContext) -> str:
    """The motor stands until a new start is commanded: the master does not start it by itself."""
    if not trial.learned.starts:
        raise NotTried("it does not start a motor")
    with trial.stand(trial.known.set_ready) as stand:
        back: list[float] = []

        def cut(data: bytes) -> Sequence[tuple[float, bytes]]:
            if not _started(stand) or back:
                return [(0.0, data)]
            back.append(stand.line.time + _OFF_S)
            stand.later(0.0, lambda: stand.line.power_off(stand.drive))
            stand.later(_OFF_S, lambda: stand.line.power_on(stand.drive))
            return []

        stand.meddler.on_reply = cut
        trial.run(stand, within_s=watch_time_s(trial))
        stand.comes_about(lambda: bool(back) and stand.now() > back[0] + 0.1, _OFF_S + 1.0)
        if (reading := trial.order.task("read")) is not None and not trial.goes_on:
            trial.run(stand, task=reading)
        heard = stand.drive.since()
        runs = stand.drive.motor.command is MotorCommand.RUN
    again = [each for each in heard if back and each.started and each.time_s > back[0]]
    if again or (runs and back):
        shown = again[0].data.hex(" ").upper() if again else "its telegrams"
        fail(
            f"it started the motor by itself after a power cycle: {shown} made it run again, "
            f"{again[0].time_s - back[0]:.1f} s after the drive regained power" if again else
            "it started the motor by itself after a power cycle"
        )  # fmt: skip
    return "the motor stands after the power cycle"


@case("killed", "start", "run", title="the master is killed while the motor runs")
def killed(trial: CaseContext) -> str:
    """The report describes the drive's behaviour without its master; every behaviour passes."""
    if not trial.learned.starts:
        raise NotTried("it does not start a motor")
    with trial.stand(trial.known.set_ready) as stand:
        trial.kill_when(stand, lambda: _started(stand))
        now = stand.now()
    return f"killed while the motor ran; {_watchdog(trial, stand, now)}"


def _watchdog(trial: CaseContext, stand: JudgeLine, now: float) -> str:
    """Return a description of the drive's behaviour without its master."""
    drive, watchdog = stand.drive, trial.known.model.watchdog
    held = ""
    if watchdog is not None:
        held = f" (parameter {watchdog.time} holds {drive.peek(watchdog.time, now)})"
    drive.follow(now + _FOR_GOOD_S)
    drive.motor.advance(drive.time_of(now + _FOR_GOOD_S))
    if drive.motor.fault:
        text = trial.known.model.faults.get(drive.motor.fault, "")
        return f"the drive's watchdog{held} stops the motor with fault {drive.motor.fault:X}h {text}".rstrip()
    if drive.motor.command is not MotorCommand.RUN:
        return f"the drive's watchdog{held} stops the motor"
    if watchdog is not None:
        return f"the motor keeps running, because the drive's watchdog{held} is not set"
    return f"the motor keeps running; {trial.known.model.link_loss or 'no watchdog of this model is known'}"
