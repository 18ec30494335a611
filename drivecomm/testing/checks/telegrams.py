"""Checks of whole telegrams: decoding, encoding, and refusing invalid bytes."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, fields_of
from drivecomm.testing.calls import is_same_data
from drivecomm.testing.checking import (
    CheckFailure,
    check,
    codec_for,
    decoded,
    expect,
    is_valid,
    message_hex,
    with_flips,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.protocol import Codec, Direction, Find, Protocol
    from drivecomm.testing.checking import VectorCase
    from drivecomm.testing.vectors import Refuse, Stream


@check("vectors", "decode")
def decodes(case: VectorCase) -> None:
    """Decoding gives the fields of the vector, or is refused in the vector's category."""
    vector = case.vector
    try:
        found = fields_of(case.codec.decode(vector.data, vector.direction))
    except TelegramError as error:
        if vector.valid:
            raise
        category = f"refused as {error.category} ({error}), the vector says {vector.error}"
        expect(error.category == vector.error, category)
        return
    expect(vector.valid, f"decoded as {found}, the vector says it is refused ({vector.error})")
    for name, wanted in vector.fields.items():
        expect(name in found, f"the field {name} is missing; decoded is {found}")
        expect(is_same_data(found[name], wanted), f"{name} is {found[name]!r}, the vector says {wanted!r}")


@check("vectors", "decode again", applies_to=is_valid)
def decodes_the_same_again(case: VectorCase) -> None:
    """Decoding the same bytes again gives an equal message, which must be immutable because a link caches it."""
    vector = case.vector
    first, again = (case.codec.decode(vector.data, vector.direction) for _ in range(2))
    expect(first == again, f"decoded {first}, and then {again}")
    hash(first)


@check("vectors", "encode", applies_to=lambda vector: vector.valid and vector.canonical)
def encodes(case: VectorCase) -> None:
    """Encoding the fields of the vector gives its bytes."""
    vector = case.vector
    built = case.codec.encode(case.plugin.message(vector.fields, vector.direction))
    expect(built == vector.data, f"encoded as {message_hex(built)}, the vector has {message_hex(vector.data)}")


@check("vectors", "encode", applies_to=lambda vector: vector.valid and not vector.canonical)
def survives_its_own_encoder(case: VectorCase) -> None:
    """A decoded message is refused by the encoder, or encoded to a telegram with the same content."""
    vector, codec = case.vector, case.codec
    message = codec.decode(vector.data, vector.direction)
    try:
        written = codec.encode(message)
    except TelegramError:
        return
    again = codec.decode(written, vector.direction)
    expect(again == message, f"decoded {message}, encoded and decoded again {again}")


@check("vectors", "trailing", applies_to=is_valid)
def refuses_what_follows(case: VectorCase) -> None:
    """A telegram with further bytes after it is refused."""
    vector = case.vector
    for tail in (b"\x00", b"\r\n", b"\xff", vector.data[-1:], vector.data):
        longer = vector.data + tail
        expect(_refuses(case, longer) or case.lists(longer), f"decoded with {message_hex(tail)} after it")


@check("vectors", "truncated", applies_to=is_valid)
def refuses_truncations(case: VectorCase) -> None:
    """A truncated telegram is refused, unless it is a shorter one that the vectors list."""
    data = case.vector.data
    for length in range(len(data)):
        cut = data[:length]
        expect(_refuses(case, cut) or case.lists(cut), f"the first {length} bytes are decoded, {message_hex(cut)}")


@check("vectors", "flipped", applies_to=is_valid, costly=True)
def refuses_flips(case: VectorCase) -> None:
    """Every single wrong bit is detected, except in the blind spots that the protocol declares."""
    data, direction = case.vector.data, case.vector.direction
    blind = case.plugin.blind_spots(data, direction)
    beyond = sorted(place for place in blind if place not in range(len(data)))
    expect(not beyond, f"the blind spot {beyond[:1]} is outside the telegram")
    for place in range(len(data)):
        for bit, flipped in enumerate(with_flips(data, place)):
            if not _refuses(case, flipped):
                expect(place in blind, f"bit {bit} of byte {place} is wrong and is not noticed: {message_hex(flipped)}")


def _refuses(case: VectorCase, data: bytes) -> bool:
    return decoded(case.codec, data, case.vector.direction) is None


@check("refusals", "refuse")
def refuses_to_encode(plugin: Protocol, refuse: Refuse) -> None:
    """An encoder raises an error of the tree for these fields."""
    codec = codec_for(plugin, refuse.options)
    try:
        data = codec.encode(plugin.message(refuse.fields, refuse.direction))
    except DriveCommError:
        return
    raise CheckFailure(
        f"encoded as {message_hex(data)}, the vector says it is refused ({refuse.reason or 'no reason'})"
    )


def finds(codec: Codec, direction: Direction, pieces: Iterable[bytes]) -> list[Find]:
    """Return everything that a framer finds in these pieces, including the gap after them."""
    framer = Framer(codec, direction)
    found = [find for piece in pieces for find in framer.feed(piece)]
    return found + framer.flush()


def frames(codec: Codec, direction: Direction, pieces: Iterable[bytes]) -> list[bytes]:
    """Return the telegrams that a framer finds in these pieces."""
    return _telegrams(finds(codec, direction, pieces))


def _telegrams(found: Iterable[Find]) -> list[bytes]:
    return [find.data for find in found if isinstance(find, Framed)]


def pieces_of(data: bytes, size: int) -> Iterator[bytes]:
    """Yield data in pieces of this size."""
    return (data[start : start + size] for start in range(0, len(data), size))


@check("vectors", "byte-by-byte")
def found_byte_by_byte(case: VectorCase) -> None:
    """Fed byte by byte, a valid telegram is found alone and whole; an invalid one is not found."""
    vector = case.vector
    found = finds(case.codec, vector.direction, pieces_of(vector.data, 1))
    if not vector.valid:
        telegrams = _telegrams(found)
        expect(vector.data not in telegrams, "a telegram that decode refuses is found in the stream")
        return
    expect(len(found) == 1 and isinstance(found[0], Framed), f"found {_listed(found)}")
    expect(found == finds(case.codec, vector.direction, [vector.data]), "found otherwise when fed whole")
    expect(_telegrams(found) == [vector.data], f"found {_listed(found)}")


@check("vectors", "shortest", applies_to=is_valid)
def is_as_long_as_the_shortest(case: VectorCase) -> None:
    """The shortest length, which measure returns for no bytes, does not exceed the length of this telegram."""
    vector = case.vector
    shortest = case.codec.measure(b"", vector.direction)
    expect(
        1 <= shortest <= len(vector.data),
        f"measure says that no {vector.direction} is shorter than {shortest}, and this one has {len(vector.data)}",
    )


@check("vectors", "five-in-a-row", applies_to=is_valid)
def found_in_a_row(case: VectorCase) -> None:
    """Five telegrams without a gap are found as five, whole and byte by byte."""
    vector = case.vector
    for size in (1, 5 * len(vector.data)):
        found = finds(case.codec, vector.direction, pieces_of(5 * vector.data, size))
        expect(_telegrams(found) == [vector.data] * 5 and len(found) == 5, f"found {_listed(found)}")


@check("vectors", "garbage-before", applies_to=is_valid, costly=True)
def found_after_garbage(case: VectorCase) -> None:
    """Bytes that begin no telegram do not hide the telegram after them."""
    vector, codec = case.vector, case.codec
    for garbage in _garbage(codec, vector.direction):
        for size in (1, len(garbage) + len(vector.data)):
            found = frames(codec, vector.direction, pieces_of(garbage + vector.data, size))
            expect(
                found == [vector.data],
                f"after {message_hex(garbage[:8])}... found {[message_hex(each) for each in found]}",
            )


@check("vectors", "false-starts", applies_to=is_valid, costly=True)
def found_after_false_starts(case: VectorCase) -> None:
    """A truncated telegram, or a character that looks like a start, does not hide the telegram that follows.

    After a gap it is always found. Without a gap, a truncated telegram and the beginning of the next one can happen to
    form a valid telegram, because repeated bytes cancel out in an exclusive-or checksum.
    """
    vector, codec = case.vector, case.codec
    starts = [vector.data[:length] for length in range(1, len(vector.data))] + [vector.data[:1] * 3]
    for start in starts:
        framer = Framer(codec, vector.direction)
        found = [*framer.feed(start), *framer.flush(), *framer.feed(vector.data), *framer.flush()]
        expect(vector.data in _telegrams(found), f"after {message_hex(start)} and a gap found {_listed(found)}")
        both = start + vector.data
        telegrams = frames(codec, vector.direction, [both])
        happened = any(both.find(telegram) < len(start) < both.find(telegram) + len(telegram) for telegram in telegrams)
        expect(
            vector.data in telegrams or happened,
            f"after {message_hex(start)} found {[message_hex(each) for each in telegrams]}",
        )


@check("vectors", "garbage-after", applies_to=is_valid, costly=True)
def found_before_garbage(case: VectorCase) -> None:
    """Bytes after a telegram do not hide it."""
    vector, codec = case.vector, case.codec
    for garbage in _garbage(codec, vector.direction):
        after_gap = Framer(codec, vector.direction)
        found = [*after_gap.feed(vector.data), *after_gap.flush()]
        expect([find.data for find in found] == [vector.data], f"found {_listed(found)}")
        rest = [*after_gap.feed(garbage), *after_gap.flush()]
        expect(not _telegrams(rest), f"found {_listed(rest)} in {message_hex(garbage[:8])}...")
        # A telegram of one character can be the beginning of a longer one; then only the gap separates them.
        if codec.measure(vector.data + garbage[:1], vector.direction) == len(vector.data):
            telegrams = frames(codec, vector.direction, [vector.data + garbage])
            expect(telegrams[:1] == [vector.data], f"before {message_hex(garbage[:8])}... found {telegrams}")


@check("vectors", "truncated-stream", applies_to=is_valid, costly=True)
def nothing_in_truncations(case: VectorCase) -> None:
    """No telegram is found in a truncated one, unless the vectors list it."""
    vector, codec = case.vector, case.codec
    for length in range(1, len(vector.data)):
        for telegram in frames(codec, vector.direction, [vector.data[:length]]):
            expect(case.lists(telegram), f"the first {length} bytes contain the telegram {message_hex(telegram)}")


@check("streams", "stream")
def found_in_stream(plugin: Protocol, stream: Stream) -> None:
    """The telegrams of a stream are found, fed whole and in pieces of every size."""
    codec = codec_for(plugin, stream.options)
    for size in range(1, len(stream.data) + 1):
        found = frames(codec, stream.direction, pieces_of(stream.data, size))
        where = f"in pieces of {size}"
        expect(tuple(found) == stream.frames, f"{where} found {[message_hex(each) for each in found]}")


def noise_of(codec: Codec, direction: Direction) -> bytes:
    """Return all characters that begin no telegram, each once."""
    return bytes(byte for byte in range(256) if codec.measure(bytes([byte]), direction) == 0)


def _garbage(codec: Codec, direction: Direction) -> list[bytes]:
    """Return strings of bytes none of which can begin a telegram."""
    silent = noise_of(codec, direction)
    if not silent:
        return []
    mixed = Random(3).choices(silent, k=48)  # noqa: S311 - repeatable on purpose
    return [silent, silent[::-1], bytes(mixed), silent[:1] * 32, silent[-1:]]


def _listed(found: list[Find]) -> str:
    names = [f"{'damaged ' if isinstance(find, Damaged) else ''}{message_hex(find.data)}" for find in found]
    return "; ".join(names) or "nothing"
