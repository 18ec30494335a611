"""Telegrams in a stream: in pieces, in rows, among noise, cut off."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from drivecomm.protocol import Damaged, Framed, Framer
from drivecomm.testing.checking import check, expect, is_valid, shown
from drivecomm.testing.subjects import codec_for

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.protocol import Codec, Direction, Find, Protocol
    from drivecomm.testing.subjects import Case
    from drivecomm.testing.vectors import Stream


def finds(codec: Codec, direction: Direction, pieces: Iterable[bytes]) -> list[Find]:
    """Return all that a framer finds in these pieces, with the gap that ends them."""
    framer = Framer(codec, direction)
    found = [find for piece in pieces for find in framer.feed(piece)]
    return found + framer.flush()


def frames(codec: Codec, direction: Direction, pieces: Iterable[bytes]) -> list[bytes]:
    """Return the telegrams that a framer finds in these pieces."""
    return [find.data for find in finds(codec, direction, pieces) if isinstance(find, Framed)]


def pieces_of(data: bytes, size: int) -> Iterator[bytes]:
    """Yield data in pieces of this size."""
    return (data[start : start + size] for start in range(0, len(data), size))


@check("vectors", "byte-by-byte")
def found_byte_by_byte(case: Case) -> None:
    """Fed byte by byte, a sound telegram is found alone and whole; a refused one is not found."""
    vector = case.vector
    found = finds(case.codec, vector.direction, pieces_of(vector.data, 1))
    if not vector.valid:
        telegrams = [find.data for find in found if isinstance(find, Framed)]
        expect(vector.data not in telegrams, "a telegram that decode refuses is found in the stream")
        return
    expect(len(found) == 1 and isinstance(found[0], Framed), f"found {_listed(found)}")
    expect(found == finds(case.codec, vector.direction, [vector.data]), "found otherwise when fed whole")
    expect(isinstance(found[0], Framed) and found[0].data == vector.data, f"found {_listed(found)}")


@check("vectors", "shortest", applies_to=is_valid)
def is_as_long_as_the_shortest(case: Case) -> None:
    """What measure says of no bytes at all, the length of the shortest telegram, is not more than this one has."""
    vector = case.vector
    shortest = case.codec.measure(b"", vector.direction)
    expect(
        1 <= shortest <= len(vector.data),
        f"measure says that no {vector.direction} is shorter than {shortest}, and this one has {len(vector.data)}",
    )


@check("vectors", "five-in-a-row", applies_to=is_valid)
def found_in_a_row(case: Case) -> None:
    """Five telegrams without a gap are found as five, whole and byte by byte."""
    vector = case.vector
    for size in (1, 5 * len(vector.data)):
        found = finds(case.codec, vector.direction, pieces_of(5 * vector.data, size))
        telegrams = [find.data for find in found if isinstance(find, Framed)]
        expect(telegrams == [vector.data] * 5 and len(found) == 5, f"found {_listed(found)}")


@check("vectors", "garbage-before", applies_to=is_valid, costly=True)
def found_after_garbage(case: Case) -> None:
    """Bytes that begin no telegram do not hide the one that follows them."""
    vector, codec = case.vector, case.codec
    for garbage in _garbage(codec, vector.direction):
        for size in (1, len(garbage) + len(vector.data)):
            found = frames(codec, vector.direction, pieces_of(garbage + vector.data, size))
            expect(found == [vector.data], f"after {shown(garbage[:8])}... found {[shown(each) for each in found]}")


@check("vectors", "false-starts", applies_to=is_valid, costly=True)
def found_after_false_starts(case: Case) -> None:
    """A telegram that breaks off, or a character that looks like a start, does not hide the telegram that follows.

    Behind a gap it is always found. Without one, a cut telegram and the beginning of the next can happen to be a sound
    telegram: the exclusive-or of something sent twice is nothing.
    """
    vector, codec = case.vector, case.codec
    starts = [vector.data[:length] for length in range(1, len(vector.data))] + [vector.data[:1] * 3]
    for start in starts:
        framer = Framer(codec, vector.direction)
        found = [*framer.feed(start), *framer.flush(), *framer.feed(vector.data), *framer.flush()]
        telegrams = [find.data for find in found if isinstance(find, Framed)]
        expect(vector.data in telegrams, f"after {shown(start)} and a gap found {_listed(found)}")
        both = start + vector.data
        telegrams = frames(codec, vector.direction, [both])
        happened = any(both.find(telegram) < len(start) < both.find(telegram) + len(telegram) for telegram in telegrams)
        expect(
            vector.data in telegrams or happened, f"after {shown(start)} found {[shown(each) for each in telegrams]}"
        )


@check("vectors", "garbage-after", applies_to=is_valid, costly=True)
def found_before_garbage(case: Case) -> None:
    """What follows a telegram does not hide it."""
    vector, codec = case.vector, case.codec
    for garbage in _garbage(codec, vector.direction):
        after_gap = Framer(codec, vector.direction)
        found = [*after_gap.feed(vector.data), *after_gap.flush()]
        expect([find.data for find in found] == [vector.data], f"found {_listed(found)}")
        rest = [*after_gap.feed(garbage), *after_gap.flush()]
        expect(not any(isinstance(find, Framed) for find in rest), f"found {_listed(rest)} in {shown(garbage[:8])}...")
        # A telegram of one character can be the beginning of a longer one; then only the gap tells.
        if codec.measure(vector.data + garbage[:1], vector.direction) == len(vector.data):
            telegrams = frames(codec, vector.direction, [vector.data + garbage])
            expect(telegrams[:1] == [vector.data], f"before {shown(garbage[:8])}... found {telegrams}")


@check("vectors", "truncated-stream", applies_to=is_valid, costly=True)
def nothing_in_truncations(case: Case) -> None:
    """In the beginning of a telegram there is none, unless it is one that the vectors list."""
    vector, codec = case.vector, case.codec
    for length in range(1, len(vector.data)):
        for telegram in frames(codec, vector.direction, [vector.data[:length]]):
            known = (vector.direction, telegram) in case.listed
            expect(known, f"the first {length} bytes contain the telegram {shown(telegram)}")


@check("streams", "stream")
def found_in_stream(plugin: Protocol, stream: Stream) -> None:
    """The telegrams of a stream are found, fed whole and in pieces of every size."""
    codec = codec_for(plugin, stream.options)
    for size in range(1, len(stream.data) + 1):
        found = frames(codec, stream.direction, pieces_of(stream.data, size))
        where = f"in pieces of {size}"
        expect(tuple(found) == stream.frames, f"{where} found {[shown(each) for each in found]}")


def noise_of(codec: Codec, direction: Direction) -> bytes:
    """Return all characters that begin no telegram, each once."""
    return bytes(byte for byte in range(256) if codec.measure(bytes([byte]), direction) == 0)


def _garbage(codec: Codec, direction: Direction) -> list[bytes]:
    """Return strings of bytes none of which can begin a telegram, so that they may hide nothing."""
    silent = noise_of(codec, direction)
    if not silent:
        return []
    mixed = Random(3).choices(silent, k=48)  # noqa: S311 - repeatable on purpose
    return [silent, silent[::-1], bytes(mixed), silent[:1] * 32, silent[-1:]]


def _listed(found: list[Find]) -> str:
    names = [f"{'damaged ' if isinstance(find, Damaged) else ''}{shown(find.data)}" for find in found]
    return "; ".join(names) or "nothing"
