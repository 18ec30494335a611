"""Telegrams in another program's log, by line of the log, with noise around them and bytes that do not decode."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.capture import PRINTED_LOG
from drivecomm.errors import TelegramError
from drivecomm.link import likely_damage, telegrams_among_noise
from drivecomm.protocol import Framed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.capture import Capture, LogPiece, Source
    from drivecomm.protocol import Codec, Direction, Find

_WAYS: Mapping[Source, tuple[Direction, ...]] = {
    "master": ("request",),
    "drive": ("reply",),
    "unknown": ("request", "reply"),
}
_OTHER: Mapping[Source, Source] = {"master": "drive", "drive": "master", "unknown": "unknown"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """Consecutive bytes of one side in a log.

    line: number of the log line in which they begin. finds: telegrams of a protocol and the noise around them; empty if
    there is no telegram. refusal: the reason why the bytes are not a telegram, with the likely damage.
    """

    line: int
    time_s: float
    data: bytes
    protocol: str = ""
    direction: Direction = "request"
    finds: Sequence[Find] = ()
    refusal: str = ""


def telegrams_of_log(log: Sequence[LogPiece], codecs: Mapping[str, Codec]) -> list[Printed]:
    """Return the contents of a log in order, each decoded in the protocol that explains most of the log.

    codecs: codecs of the protocols to try, by name. The telegrams show whether the program that printed the log was the
    master or the drive.
    """
    groups = _groups(log)
    if is_of_a_drive([(each.piece.source, each.piece.data) for each in groups], codecs):
        groups = [replace(each, piece=replace(each.piece, source=_OTHER[each.piece.source])) for each in groups]
    readings = [list(_readings(each, codecs)) for each in groups]
    # One telegram identifies its protocol less reliably than the whole log.
    weights = Counter(name for found in readings for name in {each.protocol for each in found})
    return [
        max(found, key=lambda each: weights[each.protocol]) if found else _refused(group, codecs, weights)
        for group, found in zip(groups, readings, strict=True)
    ]


def is_of_a_drive(pieces: Sequence[tuple[Source, bytes]], codecs: Mapping[str, Codec]) -> bool:
    """Whether the program that printed the log was the drive: it sent replies and received requests."""

    def telegrams(side: Mapping[Source, Source]) -> int:
        return sum(
            any(_decodes(data, codec, way) for codec in codecs.values() for way in _WAYS[side.get(source, source)])
            for source, data in pieces
            if source != "unknown"
        )

    return telegrams(_OTHER) > telegrams({})


def by_the_masters_side(capture: Capture, codecs: Mapping[str, Codec]) -> Capture:
    """Return a capture in which `master` is the real master, even if the program that printed the log was the drive."""
    if capture.provenance.tool != PRINTED_LOG or not is_of_a_drive(
        [(piece.source, piece.data) for piece in capture.pieces], codecs
    ):
        return capture
    return replace(capture, pieces=[replace(piece, source=_OTHER[piece.source]) for piece in capture.pieces])


def _groups(log: Sequence[LogPiece]) -> list[LogPiece]:
    """Join the pieces of each reply; each piece of the master is a request of its own."""
    groups: list[LogPiece] = []
    for each in log:
        before = groups[-1].piece if groups else None
        if before is not None and each.piece.source == before.source == "drive":
            groups[-1] = replace(groups[-1], piece=replace(before, data=before.data + each.piece.data))
        else:
            groups.append(each)
    return groups


def _readings(group: LogPiece, codecs: Mapping[str, Codec]) -> Iterator[Printed]:
    """Yield the group as one telegram in each protocol; if no protocol reads it whole, as telegrams among noise."""
    data, alone = group.piece.data, False
    ways = [(name, codec, way) for name, codec in codecs.items() for way in _WAYS[group.piece.source]]
    for name, codec, way in ways:
        with suppress(TelegramError):
            find = Framed(data, codec.decode(data, way))
            alone = True
            yield _printed(group, protocol=name, direction=way, finds=(find,))
    for name, codec, way in () if alone else ways:
        if finds := telegrams_among_noise(data, codec, way):
            yield _printed(group, protocol=name, direction=way, finds=finds)


def _refused(group: LogPiece, codecs: Mapping[str, Codec], weights: Counter[str]) -> Printed:
    """Return the bytes with the reason for their refusal by the protocol that explains most of the log."""
    name = max(codecs, key=lambda each: weights[each])
    way = _WAYS[group.piece.source][0]
    try:
        codecs[name].decode(group.piece.data, way)
    except TelegramError as error:
        damage = likely_damage(group.piece.data, codecs[name], way)
        likely = f"; probably {damage.cause}: {damage.remedy}" if damage else ""
        return _printed(group, protocol=name, direction=way, refusal=f"refused ({error.category}): {error}{likely}")
    return _printed(group, protocol=name, direction=way, refusal="refused (framing): too short to be certain")


def _printed(
    group: LogPiece, *, protocol: str, direction: Direction, finds: Sequence[Find] = (), refusal: str = ""
) -> Printed:
    return Printed(
        line=group.line,
        time_s=group.piece.time_s,
        data=group.piece.data,
        protocol=protocol,
        direction=direction,
        finds=finds,
        refusal=refusal,
    )


def _decodes(data: bytes, codec: Codec, way: Direction) -> bool:
    try:
        codec.decode(data, way)
    except TelegramError:
        return False
    return True
