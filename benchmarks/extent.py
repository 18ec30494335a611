"""Extent of a benchmark run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Number of repetitions, seconds of each measurement, and the cases to measure.

    tries: maximum number of attempts until a run is undisturbed. spare_s: seconds available for repeating disturbed
    runs. slow_peers: whether to measure libraries that use a whole core. Every figure is the median of the repetitions,
    and compared programs are measured in turns.
    """

    repetitions: int
    seconds: float
    baudrates: tuple[int, ...]
    line_counts: tuple[int, ...]
    slow_peers: bool
    starts: int
    tries: int
    spare_s: float
    virtual_seconds: float
    plant_seconds: float


FULL = Extent(
    repetitions=5,
    seconds=0.8,
    baudrates=(9600, 19200, 38400, 115200),
    line_counts=(1, 16, 64),
    slow_peers=True,
    starts=21,
    tries=4,
    spare_s=240.0,
    virtual_seconds=60.0,
    plant_seconds=60.0,
)
QUICK = Extent(
    repetitions=3,
    seconds=0.3,
    baudrates=(19200, 115200),
    line_counts=(64,),
    slow_peers=False,
    starts=5,
    tries=3,
    spare_s=60.0,
    virtual_seconds=20.0,
    plant_seconds=8.0,
)
