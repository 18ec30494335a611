"""Trying out traffic that cannot be laid out in places, because the listener's characters are not the speaker's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import fields_of
from drivecomm.traffic.cohabitation.verdicts import Proof, ProofTelegram
from drivecomm.traffic.cohabitation.writing import any_telegram
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from random import Random

    from drivecomm.protocol import LineSettings
    from drivecomm.traffic.cohabitation.drives import Partner
    from drivecomm.traffic.cohabitation.hearing import Reader
    from drivecomm.traffic.cohabitation.outlines import Outline

TELEGRAMS = 1500
_TOGETHER = 6
"""So many follow each other, before the listener is given a pause."""


def try_out(
    spoken: Sequence[Outline], speaker: Partner, settings: LineSettings, reader: Reader, chance: Random
) -> Proof | None:
    """Return telegrams with arbitrary contents that the reader takes for its own, None where none of those tried is."""
    for _ in range(TELEGRAMS // _TOGETHER):
        telegrams = list(conversation(spoken, speaker, settings, chance, _TOGETHER))
        taken = reader.taken(each.heard for each in telegrams)
        if taken is not None:
            offset, found = taken
            return Proof(
                telegrams=tuple(telegrams),
                offset=offset,
                taken=found.data,
                title=found.message.kind,
                fields=fields_of(found.message),
                bits=None,
            )
    return None


def conversation(
    spoken: Sequence[Outline], speaker: Partner, settings: LineSettings, chance: Random, length: int
) -> Iterator[ProofTelegram]:
    """Yield telegrams with arbitrary contents, a reply behind a request only."""
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
        yield ProofTelegram(
            title=outline.title,
            direction=outline.direction,
            data=data,
            heard=heard(data, speaker.settings, settings),
        )
