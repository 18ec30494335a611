"""Seeded faults on a virtual line: disturbances of transmissions between sender and receiver."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import LineSettings


class LineFault(Enum):
    """Kinds of faults on a line.

    Faults of a transmission, DROP: nothing arrives. CORRUPT: one character is changed. TRUNCATE: the end is missing.
    DELAY: it arrives late. DUPLICATE: it arrives twice.

    Faults of the echo of a transmission, ECHO_PARTIAL: a run of its characters is missing. ECHO_NOISY: some are
    changed.

    Faults of the line, FOREIGN: a foreign sender transmits a telegram. POWER: a drive loses power while it answers, and
    comes back.
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


TRANSMISSION_FAULTS = (LineFault.DROP, LineFault.CORRUPT, LineFault.TRUNCATE, LineFault.DELAY, LineFault.DUPLICATE)
"""Faults of a telegram on the wires."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCut:
    """Loss of power of one drive.

    share: part of its reply that is sent by then, 0 to 1. lasts_s: duration of the outage. settings: line settings
    after the outage, None for the previous ones. mismatch_s: seconds until those settings are corrected.
    """

    share: float
    lasts_s: float
    settings: LineSettings | None
    mismatch_s: float


@dataclass(slots=True, kw_only=True)
class FaultPlan:
    """Random faults of transmissions; the same seed gives the same faults.

    rate: share of transmissions that are disturbed, 0 to 1. kinds: kinds of faults, equally frequent; a kind that is
    listed twice is twice as frequent. requests, replies: whether transmissions of the master and of the drives are
    disturbed. delay_s: the longest delay. bits: limit of wrong bits in a corrupted character.

    traffic, traffic_within_s: telegrams for FOREIGN, and its longest delay after the beginning of a transmission; the
    foreign telegram uses the master's line settings.

    outage_s: longest outage of POWER. factory, mismatch_s: line settings with which half of those drives come back,
    None for always their own, and the longest time until those settings are corrected.
    """

    rate: float
    seed: int = 0
    kinds: Sequence[LineFault] = TRANSMISSION_FAULTS
    requests: bool = True
    replies: bool = True
    delay_s: float = 1.0
    bits: int = 8
    traffic: Sequence[bytes] = ()
    traffic_within_s: float = 0.1
    outage_s: float = 2.0
    factory: LineSettings | None = None
    mismatch_s: float = 3.0
    happened: dict[LineFault, int] = field(default_factory=dict)
    _random: Random = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._random = Random(self.seed)  # noqa: S311 - repeatable on purpose

    def request(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return the part of a master's transmission that arrives, as delays in seconds and bytes."""
        return self._disturb(data) if self.requests else [(0.0, data)]

    def reply(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return the part of a drive's transmission that arrives, as delays in seconds and bytes."""
        return self._disturb(data) if self.replies else [(0.0, data)]

    def echo(self, data: bytes) -> bytes:
        """Return the echo of a master's transmission from an adapter that echoes."""
        fault = self._draw(LineFault.ECHO_PARTIAL, LineFault.ECHO_NOISY)
        if fault is LineFault.ECHO_PARTIAL:
            first = self._random.randrange(len(data))
            return data[:first] + data[self._random.randint(first + 1, len(data)) :]
        if fault is LineFault.ECHO_NOISY:
            for _ in range(self._random.randint(1, 3)):
                data = _corrupted(data, self._random, self.bits)
        return data

    def foreign(self) -> list[tuple[float, bytes]]:
        """Return foreign telegrams around a transmission, as delays in seconds from its beginning and bytes."""
        if not self.traffic or self._draw(LineFault.FOREIGN) is None:
            return []
        return [(self._random.uniform(0, self.traffic_within_s), self._random.choice(self.traffic))]

    def power(self) -> PowerCut | None:
        """Return the power cut of the drive that now begins to answer, None for no power cut."""
        if self._draw(LineFault.POWER) is None:
            return None
        return PowerCut(
            share=self._random.random(),
            lasts_s=self._random.uniform(0, self.outage_s),
            settings=self._random.choice((None, self.factory)),
            mismatch_s=self._random.uniform(0, self.mismatch_s),
        )

    def _draw(self, *possible: LineFault) -> LineFault | None:
        """Return the fault that happens now if it is one of these kinds, otherwise None."""
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
        if fault is LineFault.DELAY:
            return [(self._random.uniform(0, self.delay_s), data)]
        return disturbed(fault, data, self._random, bits=self.bits)


def disturbed(
    fault: LineFault, data: bytes, random: Random, *, delay_s: float = 0.0, bits: int = 8
) -> list[tuple[float, bytes]]:
    """Return the bytes that arrive of a faulty transmission, with delays in seconds. delay_s: for LineFault.DELAY."""
    if fault is LineFault.DROP:
        return []
    if fault is LineFault.CORRUPT:
        return [(0.0, _corrupted(data, random, bits))]
    if fault is LineFault.TRUNCATE:
        return [(0.0, data[: random.randrange(len(data))])]
    if fault is LineFault.DELAY:
        return [(delay_s, data)]
    return [(0.0, data), (0.0, data)]


def _corrupted(data: bytes, random: Random, bits: int) -> bytes:
    place = random.randrange(len(data))
    mask = 0
    for _ in range(random.randint(1, bits)):
        mask |= 1 << random.randrange(8)
    return data[:place] + bytes([data[place] ^ mask]) + data[place + 1 :]


UNDISTURBED = FaultPlan(rate=0.0)
"""Plan without faults."""
