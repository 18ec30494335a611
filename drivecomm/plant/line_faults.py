"""Seeded faults on a virtual line: what happens to a transmission between its sender and its receiver."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import LineSettings


class Fault(Enum):
    """What can happen on a line.

    To a transmission, DROP: nothing arrives. CORRUPT: one character is changed. TRUNCATE: the end is missing. DELAY: it
    arrives late. DUPLICATE: it arrives twice.
    To the echo of a transmission, ECHO_PARTIAL: a run of its characters is missing. ECHO_NOISY: some are changed.
    To the line, FOREIGN: somebody else sends a telegram. POWER: a drive loses power while it answers, and comes back.
    """

    DROP = "drop"
    CORRUPT = "corrupt"
    TRUNCATE = "truncate"
    DELAY = "delay"
    DUPLICATE = "duplicate"
    ECHO_PARTIAL = "echo partial"
    ECHO_NOISY = "echo noisy"
    FOREIGN = "foreign"
    POWER = "power"


TRANSMISSION_FAULTS = (Fault.DROP, Fault.CORRUPT, Fault.TRUNCATE, Fault.DELAY, Fault.DUPLICATE)
"""What can happen to a telegram on the wires."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCut:
    """How a drive loses power.

    share: the part of its reply that is out by then, 0 to 1. lasts_s: how long it has none. settings: the line settings
    that it comes back with, None for those it had. mismatch_s: how long it keeps those, until somebody sets it right.
    """

    share: float
    lasts_s: float
    settings: LineSettings | None
    mismatch_s: float


@dataclass(slots=True, kw_only=True)
class FaultPlan:
    """Decides for each transmission whether and how it is disturbed; the same seed decides the same.

    rate: share of transmissions that are disturbed, 0 to 1. kinds: which faults happen, equally often; a kind that is
    listed twice happens twice as often. requests, replies: whether transmissions of the master and of the drives are
    disturbed. delay_s: the longest delay. bits: how many bits of a corrupted character are wrong at most.
    traffic, traffic_within_s: the telegrams that FOREIGN chooses from, and how long at most after the beginning of a
    transmission it puts one on the line, with the master's line settings.
    outage_s: how long at most POWER keeps a drive without power. factory, mismatch_s: the line settings that half of
    those drives come back with, None for always their own, and how long at most they keep them.
    """

    rate: float
    seed: int = 0
    kinds: Sequence[Fault] = TRANSMISSION_FAULTS
    requests: bool = True
    replies: bool = True
    delay_s: float = 1.0
    bits: int = 8
    traffic: Sequence[bytes] = ()
    traffic_within_s: float = 0.1
    outage_s: float = 2.0
    factory: LineSettings | None = None
    mismatch_s: float = 3.0
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

    def echo(self, data: bytes) -> bytes:
        """Return what an adapter that echoes hands back of a master's transmission."""
        fault = self._draw(Fault.ECHO_PARTIAL, Fault.ECHO_NOISY)
        if fault is Fault.ECHO_PARTIAL:
            first = self._random.randrange(len(data))
            return data[:first] + data[self._random.randint(first + 1, len(data)) :]
        if fault is Fault.ECHO_NOISY:
            for _ in range(self._random.randint(1, 3)):
                data = _corrupted(data, self._random, self.bits)
        return data

    def foreign(self) -> list[tuple[float, bytes]]:
        """Return what somebody else sends around a transmission, as delays from its beginning and bytes."""
        if not self.traffic or self._draw(Fault.FOREIGN) is None:
            return []
        return [(self._random.uniform(0, self.traffic_within_s), self._random.choice(self.traffic))]

    def power(self) -> PowerCut | None:
        """Return how the drive that now begins to answer loses power, None when it does not."""
        if self._draw(Fault.POWER) is None:
            return None
        return PowerCut(
            share=self._random.random(),
            lasts_s=self._random.uniform(0, self.outage_s),
            settings=self._random.choice((None, self.factory)),
            mismatch_s=self._random.uniform(0, self.mismatch_s),
        )

    def _draw(self, *possible: Fault) -> Fault | None:
        """Return which of these happens now; nothing when the plan chooses another kind."""
        if not self.rate or not any(kind in possible for kind in self.kinds) or self._random.random() >= self.rate:
            return None
        fault = self._random.choice(self.kinds)
        if fault not in possible:
            return None
        self.happened[fault] = self.happened.get(fault, 0) + 1
        return fault

    def _disturb(self, data: bytes) -> list[tuple[float, bytes]]:
        fault = self._draw(*TRANSMISSION_FAULTS)
        if fault is None:
            return [(0.0, data)]
        if fault is Fault.DELAY:
            return [(self._random.uniform(0, self.delay_s), data)]
        return disturbed(fault, data, self._random, bits=self.bits)


def disturbed(
    fault: Fault, data: bytes, random: Random, *, delay_s: float = 0.0, bits: int = 8
) -> list[tuple[float, bytes]]:
    """Return what arrives of a transmission to which this happens, as delays and bytes; a late one is delay_s late."""
    if fault is Fault.DROP:
        return []
    if fault is Fault.CORRUPT:
        return [(0.0, _corrupted(data, random, bits))]
    if fault is Fault.TRUNCATE:
        return [(0.0, data[: random.randrange(len(data))])]
    if fault is Fault.DELAY:
        return [(delay_s, data)]
    return [(0.0, data), (0.0, data)]


def _corrupted(data: bytes, random: Random, bits: int) -> bytes:
    place = random.randrange(len(data))
    mask = 0
    for _ in range(random.randint(1, bits)):
        mask |= 1 << random.randrange(8)
    return data[:place] + bytes([data[place] ^ mask]) + data[place + 1 :]


UNDISTURBED = FaultPlan(rate=0.0)
"""No faults."""
