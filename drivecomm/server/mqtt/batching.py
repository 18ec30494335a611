"""Batching for doors with one message per drive: each drive is published at most once a second. No I/O.

A drive is published immediately when its state changes. The same holds if a new value would replace a waiting one: no
value is dropped.
"""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.line import STATUS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.server.mqtt.content import PublishedValue

Batch: TypeAlias = "dict[str, PublishedValue]"
"""Values of one drive by quantity, for one message."""

EVERY_S = 1.0
"""Shorter than the delay of the history behind live values, so that no waiting value is published twice."""


class DriveBatches:
    """Values waiting for the next message of their drive."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[Batch]] = {}
        self._turn_s: dict[str, float] = {}
        self._states: dict[str, tuple[object, str, str]] = {}

    def add(self, samples: Sequence[PublishedValue]) -> None:
        """Queue values."""
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

    def due(self, now: float) -> list[list[PublishedValue]]:
        """Remove and return the values of all drives that are due, in rounds of one message per drive."""
        turns: list[list[Batch]] = []
        for drive in [drive for drive in self._waiting if self._turn_s.get(drive, now) <= now]:
            self._turn_s[drive] = now + EVERY_S
            turns.append(self._waiting.pop(drive))
        return [
            [sample for batch in found for sample in batch.values()] for found in zip_longest(*turns, fillvalue=_NONE)
        ]


_NONE: Batch = {}
