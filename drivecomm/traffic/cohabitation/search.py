"""The search for telegrams that prove that a possible mistake can really happen."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from drivecomm.protocol import fields_of
from drivecomm.traffic.cohabitation.sampling import Draft, TelegramWindow, any_sizes, any_telegram
from drivecomm.traffic.cohabitation.traffic_graph import is_next_telegram
from drivecomm.traffic.cohabitation.verdicts import MistakeProof, ProofTelegram
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from random import Random

    from drivecomm.protocol import LineSettings
    from drivecomm.traffic.cohabitation.drives import LineDrive
    from drivecomm.traffic.cohabitation.outlines import TelegramCharacter, TelegramOutline
    from drivecomm.traffic.cohabitation.traffic_graph import Sightings, State, TelegramFinder

ALIGNMENTS = 400
"""Number of ways that are tried to lay one telegram over the traffic; the first half uses single telegrams only."""

_PROOFS = 8
"""Number of proofs to find before the likeliest is chosen."""

_WRITINGS = 80
"""Number of attempts to fill each alignment with characters."""

TELEGRAMS = 1500
"""Number of arbitrary telegrams to try if the characters are heard differently and places cannot be compared."""

_TOGETHER = 6
"""Number of telegrams that follow each other before the listener gets a pause."""


@dataclass(frozen=True, slots=True)
class _Laid:
    """One way to lay a telegram over the traffic.

    outlines: outlines of the traffic. sizes: the sizes of their leaves of variable size.
    """

    outlines: tuple[TelegramOutline, ...]
    sizes: tuple[dict[int, int], ...]
    start: int
    wanted: TelegramOutline
    wanted_sizes: dict[int, int]


def find_proof(
    sightings: Sightings, speaker: LineDrive, settings: LineSettings, reader: TelegramFinder, chance: Random
) -> MistakeProof | None:
    """Return telegrams that the reader really mistakes for its own, the likeliest of a few; None if none was found.

    speaker: the sender of the traffic. settings: line settings of the reader.
    """
    found: list[MistakeProof] = []
    alone = [start for start in sightings.starts if not sightings.wanted[start[1][0]].to_all]
    for attempt in range(ALIGNMENTS):
        # A telegram to one drive proves more than a broadcast, so try it more often.
        starts = alone if alone and attempt % 4 else sightings.starts
        laid = _lay(sightings, sightings.way(chance.choice(starts), chance), chance)
        if laid is None or (len(laid.outlines) > 1 and attempt < ALIGNMENTS // 2):
            continue
        wanted = laid.wanted.spots(laid.wanted_sizes, chance)
        spots = [each.spots(sizes, chance) for each, sizes in zip(laid.outlines, laid.sizes, strict=True)]
        if wanted is None or any(each is None for each in spots):
            continue
        known = [each for each in spots if each is not None]
        draft = Draft(known, TelegramWindow(laid.start, wanted, sightings.traffic.hears))
        if not draft.possible:
            continue
        for _ in range(_WRITINGS):
            data = draft.written(chance)
            telegrams = None if data is None else _cut(data, known, laid.outlines, speaker, settings)
            proof = None if telegrams is None else _proof(telegrams, laid.wanted.title, draft.bits, reader)
            if proof is not None:
                found.append(proof)
                break
        if len(found) == _PROOFS:
            break
    return min(found, key=lambda proof: proof.bits or 0, default=None)


def _lay(sightings: Sightings, way: Sequence[State], chance: Random) -> _Laid | None:
    """Set the lengths of the runs along a path, and complete the first and the last telegram."""
    all_outlines = sightings.traffic.outlines
    visited: list[list[int]] = [[way[0][0][1]]]
    numbers = [way[0][0][0]]
    for (before, _), (after, _) in pairwise(way):
        if is_next_telegram(before, after, all_outlines):
            visited.append([])
            numbers.append(after[0])
        visited[-1].append(after[1])
    outlines = tuple(all_outlines[number] for number in numbers)
    wanted = sightings.wanted[way[0][1][0]]
    wanted_sizes = _sizes(wanted, [place for _, (_, place) in way])
    sizes = [_sizes(outline, places) for outline, places in zip(outlines, visited, strict=True)]
    extra = _fill_up(outlines[0], sizes[0], first=visited[0][0], last=None, chance=chance)
    _fill_up(outlines[-1], sizes[-1], first=None, last=visited[-1][-1], chance=chance)
    start = 0
    for place in outlines[0].places[: visited[0][0]]:
        start += sizes[0].get(place.leaf, 0) if place.repeats else 1
    return _Laid(outlines, tuple(sizes), start + extra, wanted, wanted_sizes)


def _sizes(outline: TelegramOutline, places: Sequence[int]) -> dict[int, int]:
    """Return the number of visits to each run of an outline."""
    return {
        place.leaf: sum(visit == number for visit in places)
        for number, place in enumerate(outline.places)
        if place.repeats
    }


def _fill_up(
    outline: TelegramOutline, sizes: dict[int, int], *, first: int | None, last: int | None, chance: Random
) -> int:
    """Lengthen runs before the first or after the last visited place; return by how much the first visited run grew."""
    lengthened = 0
    usual = any_sizes(outline, chance)
    for number, place in enumerate(outline.places):
        if not place.repeats:
            continue
        before = first is not None and number < first
        behind = last is not None and number > last
        if before or behind:
            sizes[place.leaf] = usual.get(place.leaf, 0)
        elif number in (first, last):
            more = max(0, usual.get(place.leaf, 0) - sizes[place.leaf])
            sizes[place.leaf] += more
            if number == first:
                lengthened = more
    return lengthened


def _cut(
    data: bytes,
    spots: Sequence[Sequence[TelegramCharacter]],
    outlines: Sequence[TelegramOutline],
    speaker: LineDrive,
    settings: LineSettings,
) -> list[ProofTelegram] | None:
    """Split the bytes into telegrams; return None if one of them is not a telegram of the speaker."""
    telegrams, at = [], 0
    for outline, each in zip(outlines, spots, strict=True):
        telegram = data[at : at + len(each)]
        at += len(each)
        if not speaker.sends(telegram, outline):
            return None
        telegrams.append(_proof_telegram(outline, telegram, speaker, settings))
    return telegrams


def _proof_telegram(outline: TelegramOutline, data: bytes, speaker: LineDrive, settings: LineSettings) -> ProofTelegram:
    as_heard = heard(data, speaker.settings, settings)
    return ProofTelegram(title=outline.title, direction=outline.direction, data=data, heard=as_heard)


def _proof(
    telegrams: Sequence[ProofTelegram], title: str, bits: int | None, reader: TelegramFinder
) -> MistakeProof | None:
    taken = reader.taken(each.heard for each in telegrams)
    if taken is None:
        return None
    offset, found = taken
    return MistakeProof(
        telegrams=tuple(telegrams),
        offset=offset,
        taken=found.data,
        title=title or found.message.kind,
        fields=fields_of(found.message),
        bits=bits,
    )


def try_out(
    spoken: Sequence[TelegramOutline],
    speaker: LineDrive,
    settings: LineSettings,
    reader: TelegramFinder,
    chance: Random,
) -> MistakeProof | None:
    """Return arbitrary telegrams that the reader mistakes for its own; None if no trial finds any."""
    for _ in range(TELEGRAMS // _TOGETHER):
        telegrams = list(arbitrary_telegrams(spoken, speaker, settings, chance, _TOGETHER))
        if (proof := _proof(telegrams, "", None, reader)) is not None:
            return proof
    return None


def arbitrary_telegrams(
    spoken: Sequence[TelegramOutline], speaker: LineDrive, settings: LineSettings, chance: Random, length: int
) -> Iterator[ProofTelegram]:
    """Yield telegrams with arbitrary contents; a reply follows only a request."""
    before = "reply"
    left = length
    while left:
        left -= 1
        behind = [each for each in spoken if each.direction == "request" or before == "request"] or list(spoken)
        outline = chance.choice(behind)
        content = any_telegram(outline, chance)
        data = None if content is None else speaker.settled(content, outline)
        if data is None:
            continue
        before = outline.direction
        yield _proof_telegram(outline, data, speaker, settings)
