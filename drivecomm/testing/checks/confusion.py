"""Checks against mistaken identity: replies to other requests, of other drives and protocols, and disturbed lines."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, DriveError, FileFormatError, ReplyError
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import Ask, Framed, VirtualReply, fields_of, installed, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, decoded, expect, message_hex, raise_all
from drivecomm.testing.checks.telegrams import finds
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Message, Model, Operations, Protocol
    from drivecomm.testing.bench import Bench, InterceptedDrive
    from drivecomm.testing.vectors import Vector

_PARAMETERS = 24
_DISTURBED_READS = 200


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request of one telegram, and its reply."""

    parameter: str
    asks: Message
    reply: bytes
    answers: Message


@check("confusion")
def an_answer_answers_its_question_only(plugin: Protocol, model: Model) -> None:
    """The reply about one parameter is never accepted for another, if replies name their parameter."""
    wrong = []
    with bench(plugin, model) as on:
        asked = _all_asked(on, model)
        expect(len(asked) > 1, "there are no two parameters that are each read with one telegram")
        for mine in asked:
            differs = plugin.mismatch(mine.asks, mine.answers)
            if differs:
                wrong.append(f"the answer about {mine.parameter} differs in {differs} from its own request")
            for other in asked:
                named = _names_it(mine, other)
                if named and not plugin.mismatch(mine.asks, other.answers):
                    wrong.append(f"{other.parameter}'s answer, whose {named} is its own, answers {mine.parameter}")
    raise_all(wrong)


def _names_it(mine: _Asked, other: _Asked) -> str:
    """Return the name of a field in which the two requests differ, and that each reply repeats; "" if there is none."""
    asks, asks_other = fields_of(mine.asks), fields_of(other.asks)
    answers, answers_other = fields_of(mine.answers), fields_of(other.answers)
    for name in asks.keys() & asks_other.keys() & answers.keys() & answers_other.keys():
        if asks[name] != asks_other[name] and answers[name] == asks[name] and answers_other[name] == asks_other[name]:
            return name
    return ""


@check("confusion")
def another_drive_is_not_believed(plugin: Protocol, model: Model) -> None:
    """The reply of another drive to the same request is ignored, if replies name their drive.

    If they do not, the request is declared anonymous, and the link waits out late replies on the whole line instead.
    """
    wrong = []
    operations = plugin.operations(plugin.addresses[0], resolve_options(plugin, model, {})[1], model)
    for first, second in ((plugin.addresses[0], plugin.addresses[1]), (plugin.addresses[-1], plugin.addresses[0])):
        with bench(plugin, model, addresses=(second,)) as elsewhere:
            others = {each.parameter: each for each in _all_asked(elsewhere, model)[:_PARAMETERS]}
        with bench(plugin, model, addresses=(first,)) as on:
            for parameter, other in others.items():
                if _is_anonymous(operations, parameter):
                    continue
                _answer_with(on, other.reply)
                try:
                    reading = on.drive.read(parameter)
                except ReplyError:
                    on.line.advance(60.0)
                except DriveCommError as error:
                    wrong.append(f"a reply of drive {second} about {parameter} makes drive {first} raise {error}")
                else:
                    wrong.append(f"{parameter} of drive {first} is {reading.raw!r}, a value from drive {second}")
    raise_all(wrong)


@check("confusion")
def a_write_is_not_confirmed_by_another(plugin: Protocol, model: Model) -> None:
    """If the confirmation of a write repeats the value, the confirmation of another value is not accepted.

    If it does not, the request is declared nameless, and the link waits out late replies to it instead.
    """
    wrong = []
    tried = 0
    operations = plugin.operations(plugin.addresses[0], resolve_options(plugin, model, {})[1], model)
    for info in model.parameters.values():
        if info.access != "rw" or info.start is None or isinstance(info.start, str) or tried == _PARAMETERS:
            continue
        if _is_nameless(operations, info.address, info.start):
            continue
        with bench(plugin, model) as on:
            write = partial(on.write, info.address)
            try:
                mine = _asked(on, info.address, partial(write, info.start))
                held = on.drive.read(info.address).raw
                other = _asked(on, info.address, partial(write, info.start + info.factor))
                on.drive.read(info.address)
            except DriveCommError:
                continue
            if mine is None or other is None or not _names_it(mine, other):
                continue
            tried += 1
            _answer_with(on, other.reply)
            try:
                confirmed = write(info.start)
            except DriveCommError:
                continue
            if confirmed is None or confirmed.raw == held or not confirmed.note:
                wrong.append(
                    f"{info.address} := {info.start} is confirmed by the reply that confirms {info.start + info.factor}"
                )
    raise_all(wrong)


@check("confusion")
def a_disturbed_line_tells_no_lies(plugin: Protocol, model: Model) -> None:
    """On a line where a third of all telegrams is lost, cut, late, doubled or changed, no reading is wrong.

    Each parameter of each drive holds a unique number, so that a wrong reading shows.
    """
    asked = []
    with bench(plugin, model) as quiet:
        for address in (info.address for info in model.parameters.values()):
            with suppress(DriveCommError):
                asked.append(quiet.drive.read(address).parameter)
    # Read-only values may change with time, unless the drive has no settable parameter.
    set_only_here = [each for each in asked if (info := model.find(each)) is not None and info.access != "r"]
    steady = set_only_here or asked
    kinds = (LineFault.DROP, LineFault.TRUNCATE, LineFault.DELAY, LineFault.DUPLICATE, LineFault.CORRUPT)
    plan = FaultPlan(rate=0.3, seed=17, kinds=kinds, bits=1)
    random = Random(18)  # noqa: S311 - repeatable on purpose
    good = 0
    with bench(plugin, model, addresses=plugin.addresses[:2], faults=plan, options={"attempts": 2}) as on:
        second = on.bus.drive(plugin.name, plugin.addresses[1], model=model, attempts=2)
        on.set_unique_values(model)
        for _ in range(_DISTURBED_READS):
            parameter = random.choice(steady)
            drive, virtual = random.choice(((on.drive, on.virtual), (second, on.others[0])))
            try:
                reading = drive.read(parameter)
            except (ReplyError, DriveError):
                # If requests have no checksum, a drive may refuse a request that was changed on the line.
                continue
            good += 1
            held = virtual.peek(parameter, on.line.time)
            expect(reading.raw == held, f"{parameter} of {drive.name} reads {reading.raw!r}, it holds {held!r}")
    expect(good > _DISTURBED_READS / 4, f"only {good} of {_DISTURBED_READS} reads succeed")


def _is_anonymous(operations: Operations, parameter: str) -> bool:
    command = next(operations.read(parameter))
    return isinstance(command, Ask) and command.anonymous


def _is_nameless(operations: Operations, parameter: str, value: Any) -> bool:
    for options in ({}, {"store": True}):
        try:
            command = next(operations.write(parameter, value, **options))
        except (DriveCommError, StopIteration):
            continue
        return isinstance(command, Ask) and command.nameless
    return False


def _all_asked(on: Bench, model: Model) -> list[_Asked]:
    """Read all parameters; return those that one telegram reads and that the drive answers."""
    asked = []
    for info in model.parameters.values():
        with suppress(DriveCommError):
            asked.append(_asked(on, info.address, partial(on.drive.read, info.address)))
    return [each for each in asked if each is not None]


def _asked(on: Bench, parameter: str, call: Callable[[], object]) -> _Asked | None:
    """Return the request and the reply of a call, or None if it takes more than one telegram."""
    on.virtual.heard.clear()
    on.virtual.said.clear()
    call()
    pairs = [(find, said) for find, said in zip(on.virtual.heard, on.virtual.said, strict=True) if said is not None]
    if len(pairs) != 1:
        return None
    find, said = pairs[0]
    return _Asked(parameter, find.message, said.data, on.drive.peer.codec.decode(said.data, "reply"))


def _answer_with(on: Bench, data: bytes) -> None:
    """Replace every reply of the drive with these bytes."""
    on.virtual.between = lambda _, reply: reply and VirtualReply(data=data, delay_s=reply.delay_s)


_READS = 60


@check("foreign traffic")
def is_not_believed(plugin: Protocol, other: Protocol) -> None:
    """No telegram of another protocol passes for a reply to this protocol's requests, unless declared ambiguous.

    A single character, such as ACK, is the same in all protocols that use it, and is not checked.
    """
    if other.name in plugin.ambiguous_with:
        return
    codec = plugin.codec(plugin.options())
    requests = [
        codec.decode(vector.data, "request")
        for vector in _own(plugin)
        if vector.direction == "request" and not vector.options
    ]
    wrong = []
    for vector in _own(other):
        reply = decoded(codec, vector.data, "reply")
        if reply is None or len(vector.data) == 1:
            continue
        believed = next((request for request in requests if not plugin.mismatch(request, reply)), None)
        if believed is not None:
            wrong.append(
                f"{message_hex(vector.data)} of {other.name} ({vector.id}) is mistaken for the answer to {believed}"
            )
    raise_all(wrong)


@check("foreign traffic")
def is_not_answered(plugin: Protocol, other: Protocol) -> None:
    """No virtual drive answers a telegram of another protocol, or starts its motor because of it.

    If the package declares itself ambiguous with the other protocol, at least one such telegram must be answered.
    """
    wrong = []
    for address in (plugin.addresses[0], plugin.addresses[1], plugin.addresses[-1]):
        with bench(plugin, addresses=(address,)) as on:
            wrong += [
                f"drive {address} answers {message_hex(vector.data)} of {other.name} ({vector.id})"
                for vector in _own(other)
                if _answers(on.virtual, vector.data)
            ]
            if on.virtual.motor.running:
                wrong.append(f"the motor of drive {address} runs after telegrams of {other.name}")
    if other.name in plugin.ambiguous_with:
        expect(wrong, f"declared ambiguous with {other.name}, and no telegram of it is answered")
        return
    raise_all(wrong)


def _answers(drive: InterceptedDrive, data: bytes) -> bool:
    answers = [drive.hear(find, 1.0) for find in finds(drive.codec, "request", [data]) if isinstance(find, Framed)]
    return any(answer is not None for answer in answers)


@check("foreign traffic")
def does_not_spoil_a_reading(plugin: Protocol, other: Protocol) -> None:
    """With telegrams of another protocol on the line before, during and after each request, no reading is wrong."""
    good = 0
    own = _own(other)
    foreign = [vector.data for vector in own[:: max(1, len(own) // _READS)]]
    with bench(plugin) as on:
        parameters = [info.address for info in (on.drive.model.parameters.values() if on.drive.model else ())]
        for number, data in enumerate(foreign):
            parameter = parameters[number % len(parameters)]
            # At the start of the request, while it is on its way, and when its reply is expected.
            on.line.call_at(on.line.time + (0.0, 0.002, 0.02)[number % 3], lambda data=data: on.line.inject(data))  # type: ignore[misc]
            try:
                reading = on.drive.read(parameter)
            except ReplyError:
                on.line.advance(1.0)
                continue
            except DriveCommError:
                continue
            good += 1
            held = on.virtual.peek(parameter, on.line.time)
            beside = f"beside {message_hex(data)} of {other.name}"
            expect(reading.raw == held, f"{beside}, {parameter} reads {reading.raw!r}, the drive holds {held!r}")
    tried = len(foreign)
    expect(good > tried / 3, f"beside telegrams of {other.name} only {good} of {tried} reads succeed")


def other_protocols(plugin: Protocol) -> Iterator[Protocol]:
    """Yield the other installed protocols that ship vectors."""
    for other in installed.working():
        if other.name != plugin.name and _own(other):
            yield other


def _own(plugin: Protocol) -> list[Vector]:
    try:
        return [vector for vector in packaged_vectors(plugin).vectors if vector.valid]
    except FileFormatError:
        # The conformance run of that protocol reports the broken file.
        return []
