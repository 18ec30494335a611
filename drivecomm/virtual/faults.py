"""Seeded faults on a virtual line: what happens to a transmission between its sender and its receiver."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class Fault(Enum):
    """What can happen to a transmission.

    DROP: nothing arrives. CORRUPT: one character is changed. TRUNCATE: the end is missing. DELAY: it arrives late.
    DUPLICATE: it arrives twice.
    """

    DROP = "drop"
    CORRUPT = "corrupt"
    TRUNCATE = "truncate"
    DELAY = "delay"
    DUPLICATE = "duplicate"


@dataclass(slots=True, kw_only=True)
class FaultPlan:
    """Decides for each transmission whether and how it is disturbed; the same seed decides the same.

    rate: share of transmissions that are disturbed, 0 to 1. kinds: which faults happen, equally often.
    requests, replies: whether transmissions of the master and of the drives are disturbed. delay_s: the longest delay.
    bits: how many bits of a corrupted character are wrong at most.
    """

    rate: float
    seed: int = 0
    kinds: Sequence[Fault] = tuple(Fault)
    requests: bool = True
    replies: bool = True
    delay_s: float = 1.0
    bits: int = 8
    happened: dict[Fault, int] = field(default_factory=dict)
    _random: Random = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._random = Random(self.seed)  # noqa: S311 - repeatable on purpose

    def request(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return what arrives of a master's transmission, as delays and bytes."""
        return self._disturb(data) if self.requests else [(0.0, data)]

    def reply(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return what arrives of a drive's transmission, as delays and bytes."""
        return self._disturb(data) if self.replies else [(0.0, data)]

    def _disturb(self, data: bytes) -> list[tuple[float, bytes]]:
        if self._random.random() >= self.rate:
            return [(0.0, data)]
        fault = self._random.choice(self.kinds)
        self.happened[fault] = self.happened.get(fault, 0) + 1
        if fault is Fault.DROP:
            return []
        if fault is Fault.CORRUPT:
            place = self._random.randrange(len(data))
            mask = 0
            for _ in range(self._random.randint(1, self.bits)):
                mask |= 1 << self._random.randrange(8)
            return [(0.0, data[:place] + bytes([data[place] ^ mask]) + data[place + 1 :])]
        if fault is Fault.TRUNCATE:
            return [(0.0, data[: self._random.randrange(len(data))])]
        if fault is Fault.DELAY:
            return [(self._random.uniform(0, self.delay_s), data)]
        return [(0.0, data), (0.0, data)]


UNDISTURBED = FaultPlan(rate=0.0)
