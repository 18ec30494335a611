"""Lost replies: what is asked again, what must not be, and how long a master waits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, NoReplyError, ReplyError
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import CheckFailure, check, expect, shown

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Framed, Model, Protocol, VirtualReply
    from drivecomm.testing.bench import Bench


@check("commands")
def a_lost_answer_is_asked_for_again(plugin: Protocol, model: Model) -> None:
    """A read whose answers are lost is sent as often as the drive's attempts say, the same each time, and no more."""
    with bench(plugin, model) as on:
        parameter = _readable(on, model)
        wanted = on.drive.read(parameter).raw
        for lost in range(1, on.drive.facts.timing.attempts + 1):
            sent = _losing(on, lost)
            try:
                found = on.drive.read(parameter).raw
            except NoReplyError:
                expect(lost == on.drive.facts.timing.attempts, f"{lost} lost answers end a read")
            else:
                expect(lost < on.drive.facts.timing.attempts, f"a read is still not given up after {lost} lost answers")
                expect(found == wanted, f"read again, {parameter} is {found!r} and not {wanted!r}")
            expect(len(set(sent)) == 1, "what is asked again is not what was asked")
            on.line.advance(60.0)


@check("commands")
def a_start_is_not_repeated(plugin: Protocol, model: Model) -> None:
    """The telegram that makes the motor run is never sent twice: with its answer lost, the start ends in an error."""
    for reverse in (False, True):
        with bench(plugin, model) as on:
            if reverse and not on.drive.capabilities.reverse:
                continue
            starting = _losing_what_starts(on)
            try:
                on.drive.start(reverse=reverse)
            except ReplyError:
                pass
            else:
                raise CheckFailure("the answer to the start is lost, and the start is taken for done")
            expect(starting, "a start makes no motor run")
            times = [find.data for find in on.virtual.heard].count(starting[0])
            expect(times == 1, f"{shown(starting[0])} makes the motor run, and is sent {times} times")


@check("commands")
def a_stop_is_repeated(plugin: Protocol, model: Model) -> None:
    """A stop whose first answer is lost is sent again, and the motor stands afterwards."""
    with bench(plugin, model) as on:
        on.drive.start()
        on.settle()
        before = len(on.virtual.heard)
        _losing(on, 1)
        on.drive.stop()
        expect(len(on.virtual.heard) > before + 1, "the answer to a stop is lost, and it is not asked for again")
        on.settle()
        expect(not on.virtual.motor.running, "the motor runs on")


@check("commands")
def a_deaf_drive_is_reported(plugin: Protocol, model: Model) -> None:
    """From a drive that never answers, every verb ends in NoReplyError, and not before the reply time is over."""
    verbs: dict[str, Callable[[Bench], object]] = {
        "status": lambda on: on.drive.status(),
        "probe": lambda on: on.drive.probe(),
        "start": lambda on: on.drive.start(),
        "stop": lambda on: on.drive.stop(),
        "reset": lambda on: on.drive.reset(),
        "read": lambda on: on.drive.read(next(iter(model.parameters))),
    }
    for name, verb in verbs.items():
        with bench(plugin, model) as on:
            on.virtual.between = lambda _, __: None
            try:
                verb(on)
            except NoReplyError:
                waited, least = on.line.time, on.drive.facts.timing.reply_timeout_s
                expect(waited >= least, f"{name} gives up after {waited * 1000:.1f} ms of {least * 1000:g}")
            except DriveCommError as error:
                raise CheckFailure(f"nobody answers, and {name} raises {type(error).__name__}: {error}") from error
            else:
                raise CheckFailure(f"nobody answers, and {name} is taken for done")


def _readable(on: Bench, model: Model) -> str:
    """Return a parameter that the drive tells, with one telegram."""
    for info in model.parameters.values():
        before = len(on.virtual.heard)
        try:
            on.drive.read(info.address)
        except DriveCommError:
            continue
        if len([said for said in on.virtual.said[before:] if said is not None]) == 1:
            return info.address
    raise CheckFailure("no parameter can be read with one telegram")


def _losing(on: Bench, number: int) -> list[bytes]:
    """Let the next so many answers be lost; returns a list that collects the requests of these."""
    lost: list[bytes] = []

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        if reply is None or len(lost) == number:
            return reply
        lost.append(find.data)
        return None

    on.virtual.between = between
    return lost


def _losing_what_starts(on: Bench) -> list[bytes]:
    """Lose the answer to the first telegram that makes the motor run, and all after it; returns that telegram."""
    starting: list[bytes] = []

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        if not starting and on.virtual.motor.running:
            starting.append(find.data)
        return None if starting else reply

    on.virtual.between = between
    return starting
