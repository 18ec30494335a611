"""Mistaken identity: answers to other questions, answers of other drives, and lines on which much goes wrong."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, DriveError, ReplyError
from drivecomm.plant import Fault, FaultPlan
from drivecomm.protocol import Ask, VirtualReply, fields_of, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, raise_all

if TYPE_CHECKING:
    from drivecomm.protocol import Framed, Message, Model, Operations, Protocol, Reading
    from drivecomm.testing.bench import Bench

_PARAMETERS = 24
_DISTURBED_READS = 200


@dataclass(frozen=True, slots=True)
class _Asked:
    """A question that one telegram asks, and its answer."""

    parameter: str
    request: bytes
    reply: bytes
    asks: Message
    answers: Message
    reading: Reading


@check("confusion")
def an_answer_answers_its_question_only(plugin: Protocol, model: Model) -> None:
    """The answer about one parameter is never the answer about another, where answers name what they are about."""
    wrong = []
    with bench(plugin, model) as on:
        asked = _all_asked(on, model)
        expect(len(asked) > 1, "there are no two parameters that are each read with one telegram")
        for mine in asked:
            differs = plugin.mismatch(mine.asks, mine.answers)
            if differs:
                wrong.append(f"the answer about {mine.parameter} differs in {differs} from its own question")
            for other in asked:
                named = _names_it(mine, other)
                if named and not plugin.mismatch(mine.asks, other.answers):
                    wrong.append(f"{other.parameter}'s answer, whose {named} is its own, answers {mine.parameter}")
    raise_all(wrong)


def _names_it(mine: _Asked, other: _Asked) -> str:
    """Return a field in which the questions differ, and their answers likewise."""
    asks, asks_other = fields_of(mine.asks), fields_of(other.asks)
    answers, answers_other = fields_of(mine.answers), fields_of(other.answers)
    for name in asks.keys() & asks_other.keys() & answers.keys() & answers_other.keys():
        if asks[name] != asks_other[name] and answers[name] == asks[name] and answers_other[name] == asks_other[name]:
            return name
    return ""


@check("confusion")
def another_drive_is_not_believed(plugin: Protocol, model: Model) -> None:
    """The answer that another drive would give to the same question is ignored, whatever is asked."""
    wrong = []
    for first, second in ((plugin.addresses[0], plugin.addresses[1]), (plugin.addresses[-1], plugin.addresses[0])):
        with bench(plugin, model, addresses=(second,)) as elsewhere:
            others = {each.parameter: each for each in _all_asked(elsewhere, model)[:_PARAMETERS]}
        with bench(plugin, model, addresses=(first,)) as on:
            for parameter, other in others.items():
                _answer_with(on, other.reply)
                try:
                    reading = on.drive.read(parameter)
                except ReplyError:
                    on.line.advance(60.0)
                except DriveCommError as error:
                    wrong.append(f"what drive {second} says of {parameter} makes drive {first} raise {error}")
                else:
                    wrong.append(f"{parameter} of drive {first} is {reading.raw!r}, which drive {second} said")
    raise_all(wrong)


@check("confusion")
def a_write_is_not_confirmed_by_another(plugin: Protocol, model: Model) -> None:
    """Where the confirmation of a write repeats the value, that of another value is not taken for it.

    A request that is declared nameless says that its reply proves nothing; late replies to it are waited out instead.
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
            mine = _written(on, info.address, info.start)
            other = _written(on, info.address, info.start + info.factor)
            if mine is None or other is None or not _names_it(mine, other):
                continue
            tried += 1
            _answer_with(on, other.reply)
            try:
                confirmed = _write(on, info.address, info.start)
            except DriveCommError:
                continue
            if confirmed is None or (confirmed.raw == mine.reading.raw or not confirmed.note):
                wrong.append(f"{info.address} := {info.start} is confirmed by what confirms {info.start + info.factor}")
    raise_all(wrong)


@check("confusion")
def a_disturbed_line_tells_no_lies(plugin: Protocol, model: Model) -> None:
    """On a line where a third of all telegrams is lost, cut, late, doubled or changed, no reading is wrong."""
    with bench(plugin, model) as quiet:
        steady = [each.parameter for each in _all_asked(quiet, model) if _kept(model, each.parameter)]
    kinds = (Fault.DROP, Fault.TRUNCATE, Fault.DELAY, Fault.DUPLICATE, Fault.CORRUPT)
    plan = FaultPlan(rate=0.3, seed=17, kinds=kinds, bits=1)
    random = Random(18)  # noqa: S311 - repeatable on purpose
    good = 0
    with bench(plugin, model, addresses=plugin.addresses[:2], faults=plan, options={"attempts": 2}) as on:
        second = on.bus.drive(plugin.name, plugin.addresses[1], model=model, attempts=2)
        for parameter in steady:
            # The neighbour holds something else wherever it can.
            _poke_otherwise(on, parameter, on.virtual.peek(parameter, 0.0))
        for _ in range(_DISTURBED_READS):
            parameter = random.choice(steady)
            drive, virtual = random.choice(((on.drive, on.virtual), (second, on.others[0])))
            try:
                reading = drive.read(parameter)
            except (ReplyError, DriveError):
                # Where requests have no check, a drive may have heard something else, and refused that.
                continue
            good += 1
            held = virtual.peek(parameter, on.line.time)
            expect(reading.raw == held, f"{parameter} of {drive.name} reads {reading.raw!r}, it holds {held!r}")
    expect(good > _DISTURBED_READS / 4, f"only {good} of {_DISTURBED_READS} reads come to anything")


def _is_nameless(operations: Operations, parameter: str, value: Any) -> bool:
    for options in ({}, {"store": True}):
        try:
            command = next(operations.write(parameter, value, **options))
        except (DriveCommError, StopIteration):
            continue
        return isinstance(command, Ask) and command.nameless
    return False


def _kept(model: Model, parameter: str) -> bool:
    info = model.find(parameter)
    return info is not None and info.access != "r"


def _poke_otherwise(on: Bench, parameter: str, raw: int | str) -> None:
    other = raw + 1 if isinstance(raw, int) else raw[:-1] + ("1" if raw[-1:] != "1" else "2")
    try:
        on.others[0].poke(parameter, other)
    except DriveCommError:
        return


def _all_asked(on: Bench, model: Model) -> list[_Asked]:
    """Read all parameters; return those that one telegram asks for and that are answered."""
    asked = []
    for info in model.parameters.values():
        on.virtual.heard.clear()
        on.virtual.said.clear()
        try:
            reading = on.drive.read(info.address)
        except DriveCommError:
            continue
        if (one := _asked(on, info.address, reading)) is not None:
            asked.append(one)
    return asked


def _asked(on: Bench, parameter: str, reading: Reading) -> _Asked | None:
    pairs = [(find, said) for find, said in zip(on.virtual.heard, on.virtual.said, strict=True) if said is not None]
    if len(pairs) != 1:
        return None
    find, said = pairs[0]
    codec = on.drive.peer.codec
    return _Asked(parameter, find.data, said.data, find.message, codec.decode(said.data, "reply"), reading)


def _written(on: Bench, parameter: str, value: Any) -> _Asked | None:
    on.virtual.heard.clear()
    on.virtual.said.clear()
    try:
        _write(on, parameter, value)
        pairs = [(find, said) for find, said in zip(on.virtual.heard, on.virtual.said, strict=True) if said is not None]
        reading = on.drive.read(parameter)
    except DriveCommError:
        return None
    if len(pairs) != 1:
        return None
    find, said = pairs[0]
    answers = on.drive.peer.codec.decode(said.data, "reply")
    return _Asked(parameter, find.data, said.data, find.message, answers, reading)


def _write(on: Bench, parameter: str, value: Any) -> Reading | None:
    able = on.drive.capabilities
    try:
        return on.drive.write(parameter, value)
    except DriveCommError:
        if not able.stored_writes:
            raise
        return on.drive.write(parameter, value, store=True)


def _answer_with(on: Bench, data: bytes) -> None:
    """Let all that the drive answers be this instead."""

    def between(_: Framed, reply: VirtualReply | None) -> VirtualReply | None:
        return None if reply is None else VirtualReply(data=data, delay_s=reply.delay_s)

    on.virtual.between = between
