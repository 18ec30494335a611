"""Cases of late and doubled replies: a reply must never pass for that to a later request."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.judge.cases.value_checks import (
    check_values,
    needs_values,
    right_value,
    set_test_values,
    shown_by,
    watch_time_s,
)
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import CaseFailure, fail

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.judge.shown_values import Shown
    from drivecomm.judge.trial import CaseContext
    from drivecomm.protocol import Framed, VirtualReply

_BEFORE_S, _LEEWAY_S = 0.04, 0.02
"""Lead of a late reply over the next request, and the part of it that a busy machine may use up, in seconds."""
_FRESH_S, _SOON_S = 0.05, 0.03
"""Delays on a busy machine, in seconds: from a reply to its display, and from sending a request to its arrival."""
_TIME_AFTER_TIME = 3


@case("doubled", "read", "run", title="every reply arrives twice")
def doubled(trial: CaseContext) -> str:
    """The master shows the drive's value or an error, and does not mistake a copy for the next reply."""
    why = "every reply arrived twice, and a copy is taken for the reply to the next request"
    return _twice(lambda: _alternating(trial, lambda data: [(0.0, data), (0.0, data)], why))


@case("late", "read", "run", title="the first reply arrives late, at several moments around the next request")
def late(trial: CaseContext) -> str:
    """The master shows the drive's value or an error, and does not accept a late reply for a later request."""
    needs_values(trial)
    again_s = _asks_again_after(trial)
    if again_s is None:
        again_s = trial.known.facts.timing.reply_timeout_s
    reason = ""
    for late_s in (again_s * 0.6, max(0.0, again_s - _BEFORE_S), again_s + 0.01, again_s * 1.6):
        reason = _twice(partial(_late_by, trial, late_s))
    return reason


def _late_by(trial: CaseContext, late_s: float) -> str:
    return _alternating(trial, _late_once(late_s), "a reply came late", late_s=late_s)


def _twice(play: Callable[[], str]) -> str:
    """Play a case, and repeat it if it fails: a busy machine can delay a reply beyond its planned time."""
    try:
        return play()
    except CaseFailure:
        return play()


def _late_once(late_s: float) -> Callable[[bytes], Sequence[tuple[float, bytes]]]:
    count = [0]

    def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        return [(late_s if count[0] == 1 else 0.0, data)]

    return meddle


def _asks_again_after(trial: CaseContext) -> float | None:
    """Return the seconds after which the master repeats a request without a reply; None if it never does."""
    with trial.stand(set_test_values(trial)) as stand:
        stand.meddler.on_reply = lambda _: []
        trial.run(stand, until=lambda: len(stand.drive.heard) > 1, within_s=trial.order.limit_s)
        heard = stand.drive.since()
    if len(heard) < 2:
        return None
    return heard[1].time_s - heard[0].time_s


def _alternating(
    trial: CaseContext,
    meddle: Callable[[bytes], Sequence[tuple[float, bytes]]],
    why: str,
    *,
    late_s: float | None = None,
) -> str:
    """Change the drive's value with each request, and fail if the master shows the value of an earlier request.

    The value of the previous request may be shown once, after a repeated request. It may not be shown if its reply
    arrived before the repetition, and not several times in a row.
    """
    raws = {parameter: values for parameter, values in trial.learned.raws.items() if len(values) == 2}
    asked: dict[str, list[float]] = {parameter: [] for parameter in raws}
    replied: list[float] = []
    with trial.stand(set_test_values(trial)) as stand:

        def between(find: Framed, act: Callable[[], VirtualReply | None]) -> VirtualReply | None:
            for parameter in set(trial.known.parameters_read_by(find)) & set(raws):
                stand.drive.inner.poke(parameter, raws[parameter][len(asked[parameter]) % 2])
                asked[parameter].append(stand.line.time)
            return act()

        def on_reply(data: bytes) -> Sequence[tuple[float, bytes]]:
            arrivals = meddle(data)
            wire_s = stand.drive.settings.wire_s(len(data))
            replied.extend(stand.line.time + delay_s + wire_s for delay_s, _ in arrivals)
            return arrivals

        stand.drive.between = between
        stand.meddler.on_reply = on_reply
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since()
    reason = check_values(trial, run, why, numbers=(0, 1))
    for parameter in raws:
        times = _Times(asked[parameter], sorted(replied))
        shown = [each for of, each in shown_by(trial, run) if of == parameter]
        _check_order(trial, parameter, shown, times, why)
        if late_s is None or len(asked[parameter]) < 2 or not shown:
            continue
        first, second = asked[parameter][:2]
        right = right_value(trial, parameter, 1)
        wire_s = trial.known.facts.settings.wire_s(len(heard[0].data)) + _LEEWAY_S
        before_it_asked = first + late_s < second - wire_s < shown[0].time_s
        if before_it_asked and right is not None and not trial.learned.displays[parameter].shows(shown[0], right):
            fail(
                f"it accepted a late reply: it shows {shown[0].text}, from a reply that came before the repeated "
                f"request, to which the drive replied {right}"
            )
    return reason


class _Times(NamedTuple):
    """Times at which a parameter was requested, and at which replies arrived."""

    asked: Sequence[float]
    replied: Sequence[float]

    def is_stale(self, time_s: float) -> bool:
        """Whether a value shown at this time comes from an old reply rather than from the latest one.

        In that case the master has just repeated its request, and read an old reply that was still buffered.
        """
        last = max((each for each in self.replied if each <= time_s), default=time_s)
        pending = any(last < each <= time_s for each in self.asked)
        asks = any(0 <= each - time_s < _SOON_S for each in self.asked)
        return time_s - last > _FRESH_S and (pending or asks)


def _check_order(trial: CaseContext, parameter: str, shown: Sequence[Shown], times: _Times, why: str) -> None:
    """Fail if the master repeatedly shows values from the reply to the previous request."""
    behind = 0
    for each in shown:
        count = sum(asked_at <= each.time_s for asked_at in times.asked)
        right = right_value(trial, parameter, (count - 1) % 2)
        if count < 2 or right is None:
            continue
        is_other = not trial.learned.displays[parameter].shows(each, right)
        behind = behind + 1 if is_other or times.is_stale(each.time_s) else 0
        if behind == _TIME_AFTER_TIME:
            fail(
                f"it accepted old replies: it shows {each.text}, the reply to the previous request, "
                f"{behind} times in a row; {why}"
            )
