"""Replies that are late, doubled, cut, damaged, lost, or of somebody else: a wrong value must not be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.judge.cases.judging import (
    check_values,
    holding,
    needs_values,
    pause_s,
    physical,
    shown_by,
    shows_nothing,
)
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import NotTried, fail
from drivecomm.protocol import installed
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.judge.stand import Stand
    from drivecomm.judge.trial import Trial
    from drivecomm.protocol import Framed, VirtualReply

_MOST_FLIPS = 40
_LEEWAY_S = 0.005


def _disturbed(trial: Trial, meddle: Callable[[Stand, bytes], Sequence[tuple[float, bytes]]], why: str) -> str:
    """Let something happen to each reply; return in words what the master showed. Raises CaseFailure."""
    with trial.stand(holding(trial)) as stand:
        stand.meddler.on_reply = lambda data: meddle(stand, data)
        run = trial.run(stand, within_s=pause_s(trial))
    return check_values(trial, run, why)


@case("lost", "read", "run", title="no reply arrives")
def lost(trial: Trial) -> str:
    """It shows an error or nothing, and ends."""
    with trial.stand(holding(trial)) as stand:
        stand.meddler.on_reply = lambda _: []
        run = trial.run(stand, within_s=pause_s(trial))
    return shows_nothing(trial, run, "no reply has arrived")


@case("lost-once", "read", "run", title="the first reply is lost, the others arrive")
def lost_once(trial: Trial) -> str:
    """It asks again, as a read may be repeated, and shows what the drive holds."""
    lost: list[bytes] = []

    def meddle(_: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        if not lost:
            lost.append(data)
            return []
        return [(0.0, data)]

    reason = _disturbed(trial, meddle, "its first reply was lost")
    stand = trial.stands[-1]
    heard = stand.drive.since()
    first = next((each for each in heard if each.reply in lost), None)
    if first is not None and [each.key for each in heard].count(first.key) < 2 and not shown_by(trial, stand.runs[-1]):
        fail(
            "it gave up after one reply was lost: it never asked again, and showed no value; a read may be sent "
            f"{trial.known.facts.timing.attempts} times"
        )
    return reason


@case("damaged", "read", "run", title="every reply has a wrong bit, so that its check does not fit")
def damaged(trial: Trial) -> str:
    """It shows an error or nothing."""
    needs_values(trial)

    def meddle(stand: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        return [(0.0, _with_a_wrong_bit(trial, stand, data))]

    with trial.stand(holding(trial)) as stand:
        stand.meddler.on_reply = lambda data: meddle(stand, data)
        run = trial.run(stand, within_s=pause_s(trial))
    shown = shown_by(trial, run)
    if shown:
        fail(
            f"it believed a damaged reply: it shows {shown[0][1].text}, and the check characters of no reply fitted; "
            "compute them and compare"
        )
    return shows_nothing(trial, run, "every reply was damaged")


def _with_a_wrong_bit(trial: Trial, stand: Stand, data: bytes) -> bytes:
    """Return a reply with a wrong bit that its check notices, where its value is if that can be."""
    heard = next((each for each in reversed(stand.drive.since()) if each.reply == data), None)
    others = {parameter: raws[1] for parameter, raws in trial.learned.raws.items()}
    other = trial.known.answer(heard.find, others) if heard is not None and others else None
    places = [
        place for place in range(len(data)) if other is None or data[place : place + 1] != other[place : place + 1]
    ]
    tried = [(place, bit) for place in places for bit in range(7)][: _MOST_FLIPS * 7]
    trial.random.shuffle(tried)
    # Digits become digits, so that a master that takes the text for a number still finds one.
    tried.sort(key=lambda each: not _alike(data[each[0]], data[each[0]] ^ 1 << each[1]))
    for place, bit in tried:
        flipped = data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
        if not trial.known.sound(flipped):
            return flipped
    return bytes([data[0] ^ 1, *data[1:]])


def _alike(one: int, other: int) -> bool:
    digits = b"0123456789ABCDEF"
    return (one in digits) == (other in digits)


@case("cut", "read", "run", title="the end of every reply is missing")
def cut(trial: Trial) -> str:
    """It shows an error or nothing."""
    needs_values(trial)
    count = [0]

    def meddle(data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        left = (len(data) - 1, len(data) - 2, len(data) // 2)[count[0] % 3]
        return [(0.0, data[: max(1, left)])]

    with trial.stand(holding(trial)) as stand:
        stand.meddler.on_reply = meddle
        run = trial.run(stand, within_s=pause_s(trial))
    shown = shown_by(trial, run)
    if shown:
        fail(f"it believed a cut reply: it shows {shown[0][1].text}, and no reply arrived to its end")
    return shows_nothing(trial, run, "every reply was cut")


@case("doubled", "read", "run", title="every reply arrives twice")
def doubled(trial: Trial) -> str:
    """It shows what the drive holds, or an error; no reply is taken for that to the next request."""
    why = "every reply arrived twice, and a copy is taken for the reply to the next request"
    return _alternating(trial, lambda _, data: [(0.0, data), (0.0, data)], why)


@case("noise", "read", "run", title="noise arrives before every reply")
def noise(trial: Trial) -> str:
    """It shows what the drive holds, or an error."""

    def meddle(_: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        junk = bytes(trial.random.choice((0x00, 0xFF, 0x7F, trial.random.randrange(256))) for _ in range(2))
        return [(0.0, junk), (0.0, data)]

    return _disturbed(trial, meddle, "noise arrived before each reply")


@case("echo", "read", "run", title="the master hears itself, as on some two-wire adapters")
def echo(trial: Trial) -> str:
    """It shows what the drive holds, or an error."""
    with trial.stand(holding(trial), echo=True) as stand:
        run = trial.run(stand, within_s=pause_s(trial))
    return check_values(trial, run, "it heard its own telegrams before the replies")


@case("other-drive", "read", "run", title="the reply of another drive arrives first")
def other_drive(trial: Trial) -> str:
    """It ignores that reply: it shows what its own drive holds, or an error."""
    needs_values(trial)
    others = {parameter: raws[1] for parameter, raws in trial.learned.raws.items()}

    def foreign(stand: Stand, data: bytes) -> bytes | None:
        heard = next((each for each in reversed(stand.drive.since()) if each.reply == data), None)
        reply = trial.known.reply_of_another(heard.find, others) if heard is not None else None
        return None if reply is None or reply == data else reply

    return _instead(
        trial, foreign, "that is what another drive said", "replies of this protocol do not name their drive"
    )


@case("other-question", "read", "run", title="the reply to another question arrives first")
def other_question(trial: Trial) -> str:
    """It ignores that reply: it shows what it asked for, or an error."""
    needs_values(trial)
    asked = set(trial.learned.displays)
    spare = [each for each in trial.known.model.parameters if each not in asked]
    trial.random.shuffle(spare)

    def foreign(stand: Stand, data: bytes) -> bytes | None:
        heard = next((each for each in reversed(stand.drive.since()) if each.reply == data), None)
        if heard is None or trial.known.is_write(heard.find):
            return None
        found = []
        for parameter in spare[:60]:
            values = trial.known.two_values(parameter)
            reply = trial.known.reply_to_another(heard.find, parameter, {parameter: values[0]} if values else {})
            if reply is not None and reply != data:
                if len(reply) == len(data):
                    return reply
                found.append(reply)
        return found[0] if found else None

    why = "that is the reply to another question"
    return _instead(trial, foreign, why, "replies of this protocol do not name their question")


def _instead(trial: Trial, foreign: Callable[[Stand, bytes], bytes | None], why: str, cannot: str) -> str:
    """Let the first reply to each question be another telegram, and later ones what the drive says."""
    begun: dict[object, int] = {}
    replaced: list[bytes] = []

    def meddle(stand: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        heard = next((each for each in reversed(stand.drive.since()) if each.reply == data), None)
        key = heard.key if heard is not None else None
        begun[key] = begun.get(key, 0) + 1
        other = foreign(stand, data) if begun[key] == 1 else None
        if other is None:
            return [(0.0, data)]
        replaced.append(other)
        return [(0.0, other)]

    reason = _disturbed(trial, meddle, why)
    if not replaced:
        raise NotTried(cannot)
    return reason


@case("other-protocol", "read", "run", title="a telegram of another protocol arrives instead of the first reply")
def other_protocol(trial: Trial) -> str:
    """It shows what the drive holds, or an error."""
    telegrams = []
    for plugin in installed.working():
        if plugin.name == trial.known.plugin.name or plugin.name in trial.known.plugin.ambiguous_with:
            continue
        try:
            vectors = packaged_vectors(plugin).vectors
        except DriveCommError:
            continue
        telegrams += [each.data for each in vectors if each.valid and each.direction == "reply" and each.data]
    telegrams = [each for each in telegrams if not trial.known.sound(each)]
    if not telegrams:
        raise NotTried("no other protocol is installed whose telegrams could arrive")
    count = [0]

    def meddle(_: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        if count[0] % 2 == 0:
            return [(0.0, data)]
        return [(0.0, trial.random.choice(telegrams))]

    return _disturbed(trial, meddle, "a telegram of another protocol arrived")


@case("late", "read", "run", title="the first reply arrives late, at several moments around the next request")
def late(trial: Trial) -> str:
    """It shows what the drive holds, or an error; it takes no reply for that to a later request."""
    needs_values(trial)
    again_s = _asks_again_after(trial)
    if again_s is None:
        again_s = trial.known.facts.timing.reply_timeout_s
    reason = ""
    for late_s in (again_s * 0.6, max(0.0, again_s - 0.025), again_s + 0.01, again_s * 1.6):
        reason = _alternating(trial, _late_once(late_s), "a reply came late", late_s=late_s)
    return reason


def _late_once(late_s: float) -> Callable[[Stand, bytes], Sequence[tuple[float, bytes]]]:
    count = [0]

    def meddle(_: Stand, data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        return [(late_s if count[0] == 1 else 0.0, data)]

    return meddle


def _asks_again_after(trial: Trial) -> float | None:
    """Return after how many seconds the master asks the same again if no reply comes; None if it does not."""
    with trial.stand(holding(trial)) as stand:
        stand.meddler.on_reply = lambda _: []
        trial.run(stand, until=lambda: len(stand.drive.heard) > 1, within_s=trial.order.limit_s)
        heard = stand.drive.since()
    if len(heard) < 2:
        return None
    return heard[1].time_s - heard[0].time_s


def _alternating(
    trial: Trial,
    meddle: Callable[[Stand, bytes], Sequence[tuple[float, bytes]]],
    why: str,
    *,
    late_s: float | None = None,
) -> str:
    """Let the drive hold another value for each request, and fail where a value is that of an earlier request.

    The value of the request before may be shown once, for a request that was repeated; not if its reply was there
    before that, and not time after time.
    """
    raws = {parameter: values for parameter, values in trial.learned.raws.items() if len(values) == 2}
    asked: dict[str, list[float]] = {parameter: [] for parameter in raws}
    with trial.stand(holding(trial)) as stand:

        def between(find: Framed, act: Callable[[], VirtualReply | None]) -> VirtualReply | None:
            for parameter in set(trial.known.told_by(find)) & set(raws):
                stand.drive.inner.poke(parameter, raws[parameter][len(asked[parameter]) % 2])
                asked[parameter].append(stand.line.time)
            return act()

        stand.drive.between = between
        stand.meddler.on_reply = lambda data: meddle(stand, data)
        run = trial.run(stand, within_s=pause_s(trial))
        heard = stand.drive.since()
    reason = check_values(trial, run, why, numbers=(0, 1))
    behind = 0
    for parameter, shown in shown_by(trial, run):
        times = [time_s for time_s in asked.get(parameter, ()) if time_s <= shown.time_s]
        if len(times) < 2:
            continue
        right = physical(trial, parameter, (len(times) - 1) % 2)
        if right is None or trial.learned.displays[parameter].shows(shown, right):
            behind = 0
            continue
        behind += 1
        wire_s = trial.known.facts.settings.wire_s(len(heard[0].data)) + _LEEWAY_S
        if late_s is not None and len(times) == 2 and times[0] + late_s < times[1] - wire_s:
            fail(
                f"it believed a late reply: it shows {shown.text}, from a reply that had come before it asked again; "
                f"to that the drive said {right}"
            )
        if behind > 1:
            fail(
                f"it believed old replies: it shows {shown.text}, the value of the request before; to the last one the "
                f"drive said {right}; {why}"
            )
    return reason
