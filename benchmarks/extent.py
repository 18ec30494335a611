"""How much a run measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Repetitions of every figure, seconds of each measured stretch, and which cases.

    tries: how often a run is made at most until it is undisturbed. spare_s: seconds that may be spent on repeating what
    was disturbed. slow_peers: whether libraries that fill a core are measured, too. pauses: line facts for the
    protocols whose pause before the next request is only a default of ours. Every figure is the median of the
    repetitions, and what is compared is measured in turns.
    """

    repetitions: int
    seconds: float
    baudrates: tuple[int, ...]
    line_counts: tuple[int, ...]
    slow_peers: bool
    pauses: tuple[Mapping[str, float], ...]
    processor_protocols: tuple[str, ...]
    starts: int
    tries: int
    spare_s: float
    virtual_seconds: float
    plant_seconds: float


FULL = Extent(
    repetitions=5,
    seconds=1.0,
    baudrates=(9600, 19200, 38400, 115200),
    line_counts=(1, 16, 64),
    slow_peers=True,
    pauses=({}, {"turnaround_s": 0.0}),
    processor_protocols=("fuji", "vlt3500"),
    starts=21,
    tries=4,
    spare_s=300.0,
    virtual_seconds=60.0,
    plant_seconds=60.0,
)
QUICK = Extent(
    repetitions=3,
    seconds=0.3,
    baudrates=(19200, 115200),
    line_counts=(64,),
    slow_peers=False,
    pauses=({},),
    processor_protocols=("fuji",),
    starts=5,
    tries=3,
    spare_s=60.0,
    virtual_seconds=20.0,
    plant_seconds=8.0,
)
