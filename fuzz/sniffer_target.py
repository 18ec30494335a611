"""Fuzz target for the sniffer: pieces from both sides of a line, with any pauses, searched for all protocols.

An input is a row of pieces. Each begins with a byte that holds the length of the piece (5 bits), whether a pause comes
before it (1 bit), and its sender (2 bits); the bytes of the piece follow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mutation import mutate_bytes
from target import FuzzTarget, expect

from drivecomm.capture import Piece
from drivecomm.protocol import installed
from drivecomm.testing import packaged_vectors
from drivecomm.traffic.sniffer import Sniffer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.capture import Source

_LONGEST = 32
_PAUSE = 0x20
_SOURCES: tuple[Source, ...] = ("unknown", "master", "drive", "unknown")
_PAUSE_S = 0.2
_CHARACTER_S = 0.001
_MOST_HELD = 4096 + 512
"""Limit of undecoded bytes: the sniffer's longest undecided stretch, and the beginning of a telegram after it."""


def sniffer_target() -> FuzzTarget:
    """Return the target for the sniffer with all installed protocols."""
    plugins = list(installed.working())

    def check(data: bytes) -> None:
        sniffer = Sniffer(plugins)
        fed, reported, last_s = bytearray(), 0, 0.0
        for piece in pieces_of(data):
            fed += piece.data
            found = sniffer.feed(piece)
            reported += sum(len(each.data) for each in found)
            expect(len(fed) - reported <= _MOST_HELD, f"{len(fed) - reported} bytes wait for their meaning")
            expect(all(each.time_s <= piece.time_s for each in found), "something is found before it was there")
            last_s = piece.time_s
        left = [*sniffer.flush(last_s + 1), *sniffer.finish()]
        reported += sum(len(each.data) for each in left)
        expect(reported == len(fed), f"of {len(fed)} bytes that were heard, {reported} are reported")
        expect(not sniffer.finish(), "something is left behind the end")

    return FuzzTarget(name="sniffer", check=check, seeds=(*_seeds(), *_floods()), mutate=mutate_bytes)


def pieces_of(data: bytes) -> Iterator[Piece]:
    """Yield the pieces that an input encodes."""
    place, time_s = 0, 0.0
    while place + 1 < len(data):
        how = data[place]
        taken = data[place + 1 : place + 2 + how % _LONGEST]
        time_s += _PAUSE_S * bool(how & _PAUSE) + len(taken) * _CHARACTER_S
        yield Piece(time_s=time_s, data=taken, source=_SOURCES[how >> 6])
        place += 1 + len(taken)


def _seeds() -> Iterator[bytes]:
    for plugin in installed.working():
        for vector in packaged_vectors(plugin).vectors:
            sender = 0 if vector.printed else 0x40 if vector.direction == "request" else 0x80
            asked = _written(vector.answers_to, sender and 0x40) if vector.answers_to else b""
            yield asked + _written(vector.data, sender)


def _floods() -> Iterator[bytes]:
    """Yield sequences of telegram beginnings that never end and never pause."""
    for plugin in installed.working():
        beginning = next(each.data[:1] for each in packaged_vectors(plugin).vectors if each.valid)
        yield (bytes([_LONGEST - 1]) + beginning * _LONGEST) * (2 * _MOST_HELD // _LONGEST)


def _written(data: bytes, sender: int) -> bytes:
    parts = [data[start : start + _LONGEST] for start in range(0, len(data), _LONGEST)]
    return b"".join(
        bytes([sender | (0 if number else _PAUSE) | len(part) - 1]) + part for number, part in enumerate(parts)
    )
