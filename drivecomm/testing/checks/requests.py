"""Checks of requests: retries after a lost reply, and the intent that a package declares for each request.

The intent decides which requests may be sent again, and which replies a fault plan affects. No telegram shows a wrong
intent, so it is compared with the effect of the request on a virtual drive.
"""

from __future__ import annotations

from contextlib import suppress
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.bus import open_bus
from drivecomm.errors import DriveCommError, NoReplyError, NotSupported, ReplyError, StateError
from drivecomm.protocol import Framed, MotorCommand, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import CheckFailure, check, decoded, expect, message_hex
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Model, ParameterInfo, Protocol, VirtualReply
    from drivecomm.testing.bench import Bench

# The duration of a telegram or two, and the silence before them; waiting out late replies takes seconds.
_AT_ONCE_S = 0.5

# Number of characters in one attempt, with the telegrams around it.
_FEW_TELEGRAMS = 100


@check("commands")
def a_lost_answer_is_asked_for_again(plugin: Protocol, model: Model) -> None:
    """A read whose replies are lost is sent exactly as often as the drive's attempts say, unchanged each time."""
    with bench(plugin, model) as on:
        parameter = _readable(on, model)
        wanted = on.drive.read(parameter).raw
        for lost in range(1, on.drive.facts.timing.attempts + 1):
            sent = _losing(on, lost)
            try:
                found = on.drive.read(parameter).raw
            except NoReplyError:
                expect(lost == on.drive.facts.timing.attempts, f"{lost} lost answers abort a read")
            else:
                expect(lost < on.drive.facts.timing.attempts, f"a read is not aborted after {lost} lost answers")
                expect(found == wanted, f"read again, {parameter} is {found!r} and not {wanted!r}")
            expect(len(set(sent)) == 1, "the repeated request differs from the first")
            on.line.advance(60.0)


@check("commands")
def a_start_is_not_repeated(plugin: Protocol, model: Model) -> None:
    """The telegram that starts the motor is never sent twice: if its reply is lost, the start ends in an error."""
    for reverse in (False, True):
        with bench(plugin, model) as on:
            if reverse and not on.drive.capabilities.reverse:
                continue
            _set_needed_reference(on, plugin, model)
            starting = _losing_what_starts(on)
            try:
                on.drive.start(reverse=reverse)
            except ReplyError:
                pass
            else:
                raise CheckFailure("the answer to the start is lost, and the start is reported as done")
            expect(starting, "a start does not make the motor run")
            times = [find.data for find in on.virtual.heard].count(starting[0])
            expect(times == 1, f"{message_hex(starting[0])} makes the motor run, and is sent {times} times")


@check("commands")
def a_stop_is_repeated(plugin: Protocol, model: Model) -> None:
    """A stop whose first reply is lost is sent again, and the motor stands afterwards."""
    with bench(plugin, model) as on:
        _set_needed_reference(on, plugin, model)
        on.drive.start()
        on.settle()
        before = len(on.virtual.heard)
        _losing(on, 1)
        on.drive.stop()
        expect(len(on.virtual.heard) > before + 1, "the answer to a stop is lost, and the stop is not repeated")
        on.settle()
        expect(not on.virtual.motor.running, "the motor keeps running")


@check("commands")
def a_stop_waits_for_no_late_answer(plugin: Protocol, model: Model) -> None:
    """A stop is sent immediately after a read without a reply; it does not wait for a late reply."""
    with bench(plugin, model) as on:
        _set_needed_reference(on, plugin, model)
        on.drive.start()
        on.settle()
        parameter = _readable(on, model)
        heard_at: list[float] = []

        def between(_: Framed, reply: VirtualReply | None) -> VirtualReply | None:
            heard_at.append(on.line.time)
            return reply

        on.virtual.between = lambda *_: None
        with suppress(ReplyError):
            on.drive.read(parameter)
        on.virtual.between = between
        called_at = on.line.time
        on.drive.stop()
        waited_s = heard_at[0] - called_at
        expect(waited_s < _AT_ONCE_S, f"the drive receives a stop {waited_s:.1f} s after the call")


@check("commands")
def a_stop_reaches_a_drive_that_is_not_heard(plugin: Protocol, model: Model) -> None:
    """A drive whose replies are all lost is stopped within one attempt of the call, by every way to stop.

    This holds if the same program has started the motor, and if an unknown other program has.
    """
    with bench(plugin, model) as on:
        ways = sorted(on.drive.capabilities.stops, key=lambda stop: stop.value)
    for way in ways:
        for started_here in (True, False):
            with bench(plugin, model) as on, open_bus(on.line.port) as other:
                _set_needed_reference(on, plugin, model)
                on.drive.start()
                on.settle()
                drive = on.drive if started_here else other.drive(plugin.name, on.virtual.address, model=model)
                stopped_at = _not_heard(on)
                called_at, timing, settings = on.line.time, drive.facts.timing, drive.facts.settings
                with suppress(ReplyError):
                    drive.stop(way)
                expect(stopped_at, f"a drive with lost replies never receives a stop by {way.value}")
                waited_s, most_s = stopped_at[0] - called_at, timing.reply_timeout_s + settings.wire_s(_FEW_TELEGRAMS)
                expect(
                    waited_s <= most_s,
                    f"a drive with lost replies is stopped by {way.value} only {waited_s:.2f} s after the call; one "
                    f"attempt takes {most_s:.2f} s",
                )


@check("commands")
def a_deaf_drive_is_reported(plugin: Protocol, model: Model) -> None:
    """If a drive never answers, every verb ends in NoReplyError, and not before the reply timeout."""
    verbs: dict[str, tuple[str, ...]] = dict.fromkeys(("status", "probe", "start", "stop", "reset"), ())
    verbs["read"] = (next(iter(model.parameters)),)
    for name, arguments in verbs.items():
        with bench(plugin, model) as on:
            if name == "reset" and not on.drive.capabilities.faults:
                continue
            on.virtual.between = lambda _, __: None
            try:
                getattr(on.drive, name)(*arguments)
            except NoReplyError:
                waited, least = on.line.time, on.drive.facts.timing.reply_timeout_s
                expect(waited >= least, f"{name} times out after {waited * 1000:.1f} ms instead of {least * 1000:g}")
            except DriveCommError as error:
                if name == "reset" and isinstance(error, NotSupported):
                    # A model may have no reset.
                    continue
                raise CheckFailure(f"no reply comes, and {name} raises {type(error).__name__}: {error}") from error
            else:
                raise CheckFailure(f"no reply comes, and {name} is reported as done")


def _set_needed_reference(on: Bench, plugin: Protocol, model: Model) -> None:
    """Set a reference if drives of this model refuse to start without one."""
    with bench(plugin, model) as other:
        try:
            other.drive.start()
        except StateError:
            on.set_some_reference()


def _readable(on: Bench, model: Model) -> str:
    """Return a parameter that the drive answers with one telegram."""
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
    """Drop the next N replies; the returned list records their requests."""
    lost: list[bytes] = []

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        if reply is None or len(lost) == number:
            return reply
        lost.append(find.data)
        return None

    on.virtual.between = between
    return lost


def _not_heard(on: Bench) -> list[float]:
    """Drop all replies; the returned list records the times at which the motor is no longer commanded to run."""
    times: list[float] = []

    def between(_: Framed, __: VirtualReply | None) -> VirtualReply | None:
        if on.virtual.motor.command is not MotorCommand.RUN:
            times.append(on.line.time)
        return None

    on.virtual.between = between
    return times


def _losing_what_starts(on: Bench) -> list[bytes]:
    """Drop the reply to the telegram that starts the motor and all later ones; the list records that telegram."""
    starting: list[bytes] = []

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        if not starting and on.virtual.motor.running:
            starting.append(find.data)
        return None if starting else reply

    on.virtual.between = between
    return starting


@check("commands")
def tells_asking_from_acting(plugin: Protocol, model: Model) -> None:
    """A request declared to move nothing changes nothing; read, status and probe send only such requests."""
    intent = plugin.intent
    if intent is None:
        return
    for what, find in _acting(plugin, model):
        expect(not intent(find.message).moves_nothing, f"{message_hex(find.data)} {what}, and is declared a read")
    with bench(plugin, model) as on:
        on.drive.probe()
        on.drive.status()
        on.read_first(model)
        for find in on.virtual.heard:
            expect(
                intent(find.message).moves_nothing,
                f"{message_hex(find.data)} is sent to read, and is declared to do more",
            )


@check("commands")
def tells_what_requests_are_for(plugin: Protocol, model: Model) -> None:
    """Requests that read or write a parameter declare that access; none that moves a motor is declared a read."""
    intent = plugin.intent
    if intent is None:
        return
    for what, find in _acting(plugin, model):
        told = intent(find.message)
        fits = told.access == "write" if what == _CHANGES else told.access != "read" or told.commands
        expect(fits, f"{message_hex(find.data)} {what}, and is declared a {told.access or 'command'}")
    with bench(plugin, model) as on:
        on.read_first(model)
        for find in on.virtual.heard:
            access = intent(find.message).access
            expect(access != "write", f"{message_hex(find.data)} is sent to read a parameter, and is declared a write")
        expect(
            any(intent(find.message).access == "read" for find in on.virtual.heard),
            "a parameter is read, and no telegram is declared a read",
        )


@check("commands")
def what_only_asks_moves_no_drive(plugin: Protocol, model: Model) -> None:
    """No request of the vectors that is declared to move nothing changes the command of a virtual drive's motor."""
    intent, options = plugin.intent, resolve_options(plugin, model, {})[1]
    if intent is None:
        return
    codec = plugin.codec(options)
    for vector in packaged_vectors(plugin).vectors:
        if vector.direction != "request" or not vector.valid or vector.options:
            continue
        message = decoded(codec, vector.data, "request")
        # A request without such an address is a broadcast, or ends a conversation.
        address: Any = getattr(message, "address", None)
        if message is None or address not in plugin.addresses:
            continue
        drive = plugin.virtual(address, options, model)
        before = drive.motor.command
        drive.hear(Framed(vector.data, message), 1.0)
        now = drive.motor.command
        asks = intent(message).moves_nothing
        expect(not asks or now is before, f"{vector.id} is declared a read, and commands the motor {now.value}")


_CHANGES, _MOVES, _HALTS = "changes a parameter", "makes the motor run", "stops the motor"


def _acting(plugin: Protocol, model: Model) -> list[tuple[str, Framed]]:
    """Return telegrams that change something in a virtual drive, each with its effect."""
    with bench(plugin, model) as on:
        _set_needed_reference(on, plugin, model)
        running = _watching(on, lambda: on.virtual.motor.running)
        on.drive.start()
    with bench(plugin, model) as on:
        _set_needed_reference(on, plugin, model)
        on.drive.start()
        on.settle()
        target = _watching(on, lambda: on.virtual.motor.command)
        on.drive.stop()
    changing = [*_changing(plugin, model, Decimal), *_changing(plugin, model, str)]
    found = ((_MOVES, running), (_HALTS, target), (_CHANGES, changing))
    return [(what, find) for what, finds in found for find in finds]


def _changing(plugin: Protocol, model: Model, kind: type[Decimal | str]) -> list[Framed]:
    """Return the telegrams that change the first parameter of this kind that accepts a new value."""
    for info in model.parameters.values():
        if "w" not in info.access or not isinstance(info.start, kind):
            continue
        with bench(plugin, model) as on:
            changing = _watching(on, lambda: on.virtual.peek(info.address, on.line.time))  # noqa: B023 - called within this iteration
            place = on.place
            for value in _others(info):
                with suppress(DriveCommError):
                    on.write(info.address, value)
            if changing and on.place == place:
                return changing
    return []


def _others(info: ParameterInfo) -> tuple[Decimal | str, ...]:
    """Return values near the start value of the drive; a text keeps its length."""
    if isinstance(info.start, Decimal):
        return info.start + info.factor, info.start - info.factor
    return (f"{str(info.start)[1:]}0",)


def _watching(on: Bench, look: Callable[[], object]) -> list[Framed]:
    """Record the telegrams that change the result of `look`; the returned list collects them."""
    changing: list[Framed] = []
    last = look()

    def between(find: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        nonlocal last
        now = look()
        if now != last:
            last = now
            changing.append(find)
        return reply

    on.virtual.between = between
    return changing
