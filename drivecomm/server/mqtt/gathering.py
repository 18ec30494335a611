"""Whose turn it is where all values of a drive go in one message: each drive's comes once a second at most. No I/O.

A drive whose state changes has its turn at once, and so has one of which a value waits that the next one would replace:
nothing is left out.
"""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.line import STATUS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.server.mqtt.content import Sample

Batch: TypeAlias = "dict[str, Sample]"
"""Values of one drive by their quantities, for one message."""

EVERY_S = 1.0
"""Shorter than what the history waits for live values, so that none that waits here is published twice."""


class Gathering:
    """Values that wait for the turn of their drive."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[Batch]] = {}
        self._turn_s: dict[str, float] = {}
        self._states: dict[str, tuple[object, str, str]] = {}

    def add(self, samples: Sequence[Sample]) -> None:
        """Have values wait."""
        for sample in samples:
            batches = self._waiting.setdefault(sample.drive, [{}])
            if sample.name in batches[-1]:
                batches.append({})
                self._turn_s.pop(sample.drive, None)
            batches[-1][sample.name] = sample
            if sample.name == STATUS:
                state = sample.value, sample.text, sample.quality
                if self._states.get(sample.drive) != state:
                    self._states[sample.drive] = state
                    self._turn_s.pop(sample.drive, None)

    def due(self, now: float) -> list[list[Sample]]:
        """Return the values of drives whose turn it is, which wait no more, in rounds of one message for each drive."""
        turns: list[list[Batch]] = []
        for drive in [drive for drive in self._waiting if self._turn_s.get(drive, now) <= now]:
            self._turn_s[drive] = now + EVERY_S
            turns.append(self._waiting.pop(drive))
        return [
            [sample for batch in found for sample in batch.values()] for found in zip_longest(*turns, fillvalue=_NONE)
        ]


_NONE: Batch = {}
