"""Checks of replies: whether they match their requests, and how the virtual drive answers."""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveError, ReplyError, UsageError
from drivecomm.protocol import Noise, Refuses, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, known_model, message_hex
from drivecomm.testing.checks.telegrams import finds

if TYPE_CHECKING:
    from drivecomm.protocol import Framed, Model, Protocol, VirtualDrive, VirtualReply
    from drivecomm.testing.bench import Bench
    from drivecomm.testing.checking import VectorCase
    from drivecomm.testing.vectors import Vector

_NOW = 1.0


def _is_request(vector: Vector) -> bool:
    return vector.valid and vector.direction == "request"


@check("vectors", "answers", applies_to=lambda vector: vector.valid and vector.answers_to is not None)
def belongs_to_its_request(case: VectorCase) -> None:
    """The protocol matches the reply as the vector says: it answers the request, or differs in the named field."""
    vector, codec = case.vector, case.codec
    request_data = vector.answers_to or b""
    request = codec.decode(request_data, "request")
    reply = codec.decode(vector.data, "reply")
    # The link recognises an echo by its bytes, without the protocol. If the reply equals the request, as to a mirror
    # telegram, the protocol decides.
    is_echo = vector.data == request_data and not vector.answers
    found = "echo" if is_echo else case.plugin.mismatch(request, reply)
    wanted = "" if vector.answers else vector.mismatch
    expect(found == wanted, f"differs in {found or 'nothing'}, the vector says {wanted or 'nothing'}")


@check("vectors", "silence", applies_to=lambda vector: _is_request(vector) and not vector.reply_expected)
def stays_silent(case: VectorCase) -> None:
    """No drive answers this request: neither its addressee, nor a drive that overhears it."""
    for address in _some_addresses(case):
        answers = _answers(case, address)
        expect(not answers, f"drive {address} answers {[message_hex(answer.data) for answer in answers]}")


@check("vectors", "virtual-drive", applies_to=lambda vector: _is_request(vector) and vector.reply_expected)
def is_answered_by_the_right_drive(case: VectorCase) -> None:
    """The virtual drive's answer, if any, matches this request; other drives are silent."""
    vector, codec, plugin = case.vector, case.codec, case.plugin
    request = codec.decode(vector.data, "request")
    own: Any = getattr(request, "address", None)
    # A request without an address is for the only drive of its line.
    for address in _some_addresses(case) if own is not None else ():
        answers = _answers(case, address) if address != own else []
        expect(not answers, f"the request is for {own}, and drive {address} answers")
    if own not in plugin.addresses:
        return
    answers = _answers(case, own)
    expect(len(answers) <= 1, f"drive {own} answers {len(answers)} times")
    for answer in answers:
        reply = codec.decode(answer.data, "reply")
        differs = plugin.mismatch(request, reply)
        expect(not differs, f"drive {own} answers {message_hex(answer.data)}, which differs in {differs}")
        expect(answer.delay_s >= 0, f"drive {own} answers {-answer.delay_s} s before the request")


@check("vectors", "virtual-drive", applies_to=lambda vector: vector.direction == "request" and not vector.valid)
def survives_damage(case: VectorCase) -> None:
    """A drive that receives an invalid telegram raises nothing, and sends a valid reply or none."""
    for address in _some_addresses(case):
        for answer in _answers(case, address):
            case.codec.decode(answer.data, "reply")


def _some_addresses(case: VectorCase) -> list[int]:
    """Return the two lowest addresses and the highest one that are valid for a drive of this variant."""
    exists, addresses = partial(_exists, case), case.plugin.addresses
    return sorted({*islice(filter(exists, addresses), 2), *islice(filter(exists, reversed(addresses)), 1)})


def _exists(case: VectorCase, address: int) -> bool:
    try:
        _drive(case, address)
    except UsageError:
        return False
    return True


def _answers(case: VectorCase, address: int) -> list[VirtualReply]:
    """Return the replies of a drive at this address to the telegram, with nothing after it."""
    drive = _drive(case, address)
    found = finds(drive.codec, "request", [case.vector.data])
    replies = [drive.hear(find, _NOW) for find in found if not isinstance(find, Noise)]
    return [reply for reply in replies if reply is not None]


def _drive(case: VectorCase, address: int) -> VirtualDrive:
    """Return a drive of the variant that matches the telegram's options and fields."""
    plugin = case.plugin
    model = known_model(plugin, plugin.default_model)
    own = {field.name for field in dataclass_fields(plugin.options)}
    said = {**model.options, **case.vector.options, **case.vector.fields}
    given = {name: value for name, value in said.items() if name in own}
    try:
        options = plugin.options(**given)
    except UsageError:
        options = plugin.options()
    return plugin.virtual(address, options, model)


@check("parameters")
def a_refusal_is_no_reading(plugin: Protocol, model: Model) -> None:
    """A read that a virtual drive refuses, with any code that the protocol lists, is an error and never a value."""
    with bench(plugin, model) as on:
        drive, parameter = on.virtual.inner, on.read_first(model)
        if not isinstance(drive, Refuses) or not parameter:
            return
        _, options = resolve_options(plugin, model, {})
        for code in plugin.refusals(options, model):
            refused: list[VirtualReply] = []
            on.virtual.between = partial(_refused, on, code, refused)
            try:
                reading = on.drive.read(parameter)
            except (DriveError, ReplyError):
                on.line.advance(60.0)
            else:
                # Not every request can be refused with every code.
                expect(not refused, f"{parameter} is refused with code {code}, and reads {reading.raw!r}")


def _refused(
    on: Bench, code: int, refused: list[VirtualReply], find: Framed, reply: VirtualReply | None
) -> VirtualReply | None:
    inner: Any = on.virtual.inner
    made: VirtualReply | None = inner.refusing(find, code, on.line.time)
    if made is None:
        return reply
    refused.append(made)
    return made
