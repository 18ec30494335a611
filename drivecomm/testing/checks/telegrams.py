"""Whole telegrams: fields out of bytes, bytes out of fields, and everything that must be refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import fields_of
from drivecomm.testing.calls import same
from drivecomm.testing.checking import CheckFailure, check, expect, is_valid, shown
from drivecomm.testing.subjects import codec_for

if TYPE_CHECKING:
    from drivecomm.protocol import Protocol
    from drivecomm.testing.subjects import Case
    from drivecomm.testing.vectors import Refuse


@check("vectors", "decode")
def decodes(case: Case) -> None:
    """Decoding gives the fields of the vector, or is refused in its category."""
    vector = case.vector
    if not vector.valid:
        _refused_as(case, vector.error)
        return
    found = fields_of(case.codec.decode(vector.data, vector.direction))
    for name, wanted in vector.fields.items():
        expect(name in found, f"the field {name} is missing; decoded is {found}")
        expect(same(found[name], wanted), f"{name} is {found[name]!r}, the vector says {wanted!r}")


def _refused_as(case: Case, category: str | None) -> None:
    try:
        found = case.codec.decode(case.vector.data, case.vector.direction)
    except TelegramError as error:
        expect(error.category == category, f"refused as {error.category} ({error}), the vector says {category}")
    else:
        raise CheckFailure(f"decoded as {fields_of(found)}, the vector says it is refused ({category})")


@check("vectors", "encode", applies_to=lambda vector: vector.valid and vector.canonical)
def encodes(case: Case) -> None:
    """Encoding the fields of the vector gives its bytes."""
    vector = case.vector
    built = case.codec.encode(case.plugin.message(vector.fields, vector.direction))
    expect(built == vector.data, f"encoded as {shown(built)}, the vector has {shown(vector.data)}")


@check("vectors", "encode", applies_to=lambda vector: vector.valid and not vector.canonical)
def survives_its_own_encoder(case: Case) -> None:
    """What was decoded is refused by the encoder, or encoded so that it says the same again."""
    vector, codec = case.vector, case.codec
    message = codec.decode(vector.data, vector.direction)
    try:
        written = codec.encode(message)
    except TelegramError:
        return
    again = codec.decode(written, vector.direction)
    expect(again == message, f"decoded {message}, encoded and decoded again {again}")


@check("vectors", "trailing", applies_to=is_valid)
def refuses_what_follows(case: Case) -> None:
    """A telegram with anything after it is no telegram."""
    vector = case.vector
    for tail in (b"\x00", b"\r\n", b"\xff", vector.data[-1:], vector.data):
        longer = vector.data + tail
        expect(_refuses(case, longer) or _is_listed(case, longer), f"decoded with {shown(tail)} after it")


@check("vectors", "truncated", applies_to=is_valid)
def refuses_truncations(case: Case) -> None:
    """The beginning of a telegram is none, unless it is a shorter one that the vectors list."""
    data = case.vector.data
    for length in range(len(data)):
        cut = data[:length]
        expect(_refuses(case, cut) or _is_listed(case, cut), f"the first {length} bytes are decoded, {shown(cut)}")


@check("vectors", "flipped", applies_to=is_valid, costly=True)
def refuses_flips(case: Case) -> None:
    """Every single wrong bit is noticed, except where the protocol declares that it cannot."""
    data, direction = case.vector.data, case.vector.direction
    blind = case.plugin.blind_spots(data, direction)
    beyond = sorted(place for place in blind if place not in range(len(data)))
    expect(not beyond, f"the blind spot {beyond[:1]} is outside the telegram")
    for place in range(len(data)):
        for bit in range(8):
            flipped = data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
            if not _refuses(case, flipped):
                expect(place in blind, f"bit {bit} of byte {place} is wrong and is not noticed: {shown(flipped)}")


def _refuses(case: Case, data: bytes) -> bool:
    try:
        case.codec.decode(data, case.vector.direction)
    except TelegramError:
        return True
    return False


def _is_listed(case: Case, data: bytes) -> bool:
    return (case.vector.direction, data) in case.listed


@check("refusals", "refuse")
def refuses_to_encode(plugin: Protocol, refuse: Refuse) -> None:
    """An encoder raises an error of the tree for these fields."""
    codec = codec_for(plugin, refuse.options)
    try:
        data = codec.encode(plugin.message(refuse.fields, refuse.direction))
    except DriveCommError:
        return
    raise CheckFailure(f"encoded as {shown(data)}, the vector says it is refused ({refuse.reason or 'no reason'})")
