"""Writing telegrams character by character, so that they hold what another reader is to find in them."""

from __future__ import annotations

from dataclasses import dataclass
from math import log2
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from random import Random

    from drivecomm.traffic.cohabitation.outlines import Outline, Spot

_USUAL_RUN = 40
"""Longer runs of characters are written only where nothing else fits."""


@dataclass(frozen=True, slots=True)
class Window:
    """Where another telegram is to be found.

    start: where it begins. spots: those that it has. hears: what becomes of each character on the way to its reader.
    """

    start: int
    spots: Sequence[Spot]
    hears: bytes


def any_sizes(outline: Outline, chance: Random) -> dict[int, int]:
    """Return sizes for the leaves of variable size, short ones as a rule."""
    sizes = {}
    for leaf, length in outline.lengths.items():
        known = list(length.by_size)
        usual = [size for size in known if size <= _USUAL_RUN] or known[:1]
        sizes[leaf] = chance.choice(usual) if usual else 0
    return sizes


class Draft:
    """Telegrams, one after the other, with characters still to be chosen. telegrams: the spots of each."""

    def __init__(self, telegrams: Sequence[Sequence[Spot]], window: Window | None = None) -> None:
        self._starts: list[int] = []
        self._spots: list[Spot] = []
        self._choices: list[tuple[int, ...]] = []
        self._window = window
        for spots in telegrams:
            self._starts.extend([len(self._spots)] * len(spots))
            self._spots.extend(spots)
        for at, spot in enumerate(self._spots):
            choices = spot.allowed
            if (looked_for := self._looked_for(at)) is not None and window is not None:
                choices = frozenset(code for code in choices if window.hears[code] in looked_for.allowed)
            self._choices.append(tuple(sorted(choices)))

    @property
    def possible(self) -> bool:
        """Whether each character is left a choice."""
        return all(self._choices)

    @property
    def bits(self) -> int:
        """How many bits have to fall right by chance for what the window looks for, check characters included."""
        odds = 0.0
        for at, spot in enumerate(self._spots):
            looked_for = self._looked_for(at)
            if looked_for is None:
                continue
            choices = len(self._choices[at])
            odds += log2(len(spot.allowed)) - (0 if looked_for.check else log2(choices))
        return round(odds)

    def written(self, chance: Random) -> bytes | None:
        """Return characters in which every check is right, None where this attempt came to none."""
        data = bytearray()
        heard = bytearray()
        window = self._window
        off = chance.random() < 0.5
        for at, spot in enumerate(self._spots):
            choices: Sequence[int] = self._choices[at]
            if spot.check is not None:
                check, number = spot.check
                said = (
                    check.off
                    if off and check.off is not None
                    else check.compute(bytes(data[self._starts[at] + check.start : at - number]))
                )
                choices = [said[number]] if said[number] in choices else []
            looked_for = self._looked_for(at)
            if window is not None and looked_for is not None and looked_for.check is not None:
                check, number = looked_for.check
                covered = bytes(heard[window.start + check.start : at - number])
                wanted = {check.compute(covered)[number]}
                if check.off is not None:
                    wanted.add(check.off[number])
                choices = [code for code in choices if window.hears[code] in wanted]
            if not choices:
                return None
            code = chance.choice(choices)
            data.append(code)
            heard.append(window.hears[code] if window is not None else code)
        return bytes(data)

    def _looked_for(self, at: int) -> Spot | None:
        window = self._window
        if window is None or not window.start <= at < window.start + len(window.spots):
            return None
        return window.spots[at - window.start]


def any_telegram(outline: Outline, chance: Random, sizes: Mapping[int, int] | None = None) -> bytes | None:
    """Return a telegram of this form with arbitrary contents, None where this attempt came to none."""
    spots = outline.spots(any_sizes(outline, chance) if sizes is None else sizes, chance)
    return None if spots is None else Draft([spots]).written(chance)
