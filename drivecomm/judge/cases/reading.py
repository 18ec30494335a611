"""Cases of replies that are cut, damaged, lost, or from another drive: no wrong value may be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.judge.cases.value_checks import (
    check_values,
    needs_values,
    set_test_values,
    shown_by,
    shows_nothing,
    watch_time_s,
)
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import NotTried, fail
from drivecomm.protocol import installed
from drivecomm.testing import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TypeAlias

    from drivecomm.judge.process import Run
    from drivecomm.judge.stand import JudgeLine
    from drivecomm.judge.trial import CaseContext

    Meddle: TypeAlias = Callable[[JudgeLine, bytes], Sequence[tuple[float, bytes]]]

_MOST_FLIPS = 40


def _run(trial: CaseContext, meddle: Meddle) -> Run:
    """Run the master once with a disturbance of each reply."""
    with trial.stand(set_test_values(trial)) as stand:
        stand.meddler.on_reply = lambda data: meddle(stand, data)
        return trial.run(stand, within_s=watch_time_s(trial))


def _disturbed(trial: CaseContext, meddle: Meddle, why: str) -> str:
    """Run the master with each reply disturbed; return a sentence on the values shown. Raises CaseFailure."""
    return check_values(trial, _run(trial, meddle), why)


def _believes_nothing(trial: CaseContext, meddle: Meddle, believed: str, why: str) -> str:
    """Run the master without any valid reply; return a sentence that it showed no value. Raises CaseFailure."""
    needs_values(trial)
    run = _run(trial, meddle)
    if shown := shown_by(trial, run):
        fail(believed.format(shown[0][1].text))
    return shows_nothing(trial, run, why)


@case("lost", "read", "run", title="no reply arrives")
def lost(trial: CaseContext) -> str:
    """The master shows an error or nothing, and ends."""
    return shows_nothing(trial, _run(trial, lambda *_: []), "no reply has arrived")


@case("lost-once", "read", "run", title="the first reply is lost, the others arrive")
def lost_once(trial: CaseContext) -> str:
    """The master repeats its request, as a read may be repeated, and shows the drive's value."""
    lost: list[bytes] = []

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
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


@case("damaged", "read", "run", title="every reply has a wrong bit, so its check fails")
def damaged(trial: CaseContext) -> str:
    """The master shows an error or nothing."""
    return _believes_nothing(
        trial,
        lambda stand, data: [(0.0, _with_a_wrong_bit(trial, stand, data))],
        "it accepted a damaged reply: it shows {}, and no reply had valid check characters; compute them and compare",
        "every reply was damaged",
    )


def _with_a_wrong_bit(trial: CaseContext, stand: JudgeLine, data: bytes) -> bytes:
    """Return a reply with a wrong bit that its checksum detects, preferably within its value."""
    heard = stand.drive.answered(data)
    others = {parameter: raws[1] for parameter, raws in trial.learned.raws.items()}
    other = trial.known.answer(heard.find, others) if heard is not None and others else None
    places = [
        place for place in range(len(data)) if other is None or data[place : place + 1] != other[place : place + 1]
    ]
    tried = [(place, bit) for place in places for bit in range(7)][: _MOST_FLIPS * 7]
    trial.random.shuffle(tried)
    # Digits become digits, so that a master that skips the checksum still reads a number.
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
def cut(trial: CaseContext) -> str:
    """The master shows an error or nothing."""
    count = [0]

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        left = (len(data) - 1, len(data) - 2, len(data) // 2)[count[0] % 3]
        return [(0.0, data[: max(1, left)])]

    believed = "it accepted a truncated reply: it shows {}, and no reply arrived complete"
    return _believes_nothing(trial, meddle, believed, "every reply was truncated")


@case("noise", "read", "run", title="noise arrives before every reply")
def noise(trial: CaseContext) -> str:
    """The master shows the drive's value or an error."""

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        junk = bytes(trial.random.choice((0x00, 0xFF, 0x7F, trial.random.randrange(256))) for _ in range(2))
        return [(0.0, junk), (0.0, data)]

    return _disturbed(trial, meddle, "noise arrived before each reply")


@case("echo", "read", "run", title="the master receives its own telegrams, as on some two-wire adapters")
def echo(trial: CaseContext) -> str:
    """The master shows the drive's value or an error."""
    with trial.stand(set_test_values(trial), echo=True) as stand:
        run = trial.run(stand, within_s=watch_time_s(trial))
    return check_values(trial, run, "it received its own telegrams before the replies")


@case("other-drive", "read", "run", title="the reply of another drive arrives first")
def other_drive(trial: CaseContext) -> str:
    """The master ignores that reply, and shows its own drive's value or an error."""
    needs_values(trial)
    others = {parameter: raws[1] for parameter, raws in trial.learned.raws.items()}

    def foreign(stand: JudgeLine, data: bytes) -> bytes | None:
        heard = stand.drive.answered(data)
        reply = trial.known.reply_of_another(heard.find, others) if heard is not None else None
        return None if reply is None or reply == data else reply

    return _instead(
        trial, foreign, "that value is from another drive", "replies of this protocol do not name their drive"
    )


@case("other-question", "read", "run", title="the reply to another request arrives first")
def other_question(trial: CaseContext) -> str:
    """The master ignores that reply, and shows the requested value or an error."""
    needs_values(trial)
    asked = set(trial.learned.displays)
    taken = {raw for values in trial.learned.raws.values() for raw in values}
    spare = [each for each in trial.known.model.parameters if each not in asked]
    trial.random.shuffle(spare)

    def foreign(stand: JudgeLine, data: bytes) -> bytes | None:
        heard = stand.drive.answered(data)
        if heard is None or trial.known.is_write(heard.find):
            return None
        found = []
        for parameter in spare[:60]:
            values = trial.known.two_values(parameter, taken)
            reply = trial.known.reply_to_another(heard.find, parameter, {parameter: values[-1]} if values else {})
            if reply is not None and reply != data:
                if len(reply) == len(data):
                    return reply
                found.append(reply)
        return found[0] if found else None

    why = "that is the reply to another request"
    return _instead(trial, foreign, why, "replies of this protocol do not name their request")


def _instead(trial: CaseContext, foreign: Callable[[JudgeLine, bytes], bytes | None], why: str, cannot: str) -> str:
    """Replace the first reply to each request by a foreign telegram; later replies are the drive's own."""
    begun: dict[object, int] = {}
    replaced: list[bytes] = []

    def meddle(stand: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        heard = stand.drive.answered(data)
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
def other_protocol(trial: CaseContext) -> str:
    """The master shows the drive's value or an error."""
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

    def meddle(_: JudgeLine, data: bytes) -> Sequence[tuple[float, bytes]]:
        count[0] += 1
        if count[0] % 2 == 0:
            return [(0.0, data)]
        return [(0.0, trial.random.choice(telegrams))]

    return _disturbed(trial, meddle, "a telegram of another protocol arrived")
