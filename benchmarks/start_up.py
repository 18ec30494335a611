"""What the import and the command line cost before anything happens."""

from __future__ import annotations

import subprocess
import sys
import time
from statistics import median
from typing import TYPE_CHECKING

from report import Figure, Section
from yardstick import slowness

if TYPE_CHECKING:
    from equipment import Equipment

_STARTS: dict[str, tuple[list[str], float | None]] = {
    "import drivecomm": (["-c", "import drivecomm"], 60.0),
    "drivecomm --version": (["-m", "drivecomm", "--version"], 150.0),
    "drivecomm --help": (["-m", "drivecomm", "--help"], None),
    "drivecomm protocols": (["-m", "drivecomm", "protocols"], None),
}
# A bare interpreter, on the undisturbed machine that the limits were set on.
_QUIET_BARE_MS = 15.0


def measure(equipment: Equipment) -> list[Section]:
    """Measure each against a bare interpreter in the same run."""
    section = Section(
        title="Start-up",
        about="Milliseconds over a bare interpreter, median of interleaved starts.",
        head=("what", "ms more", "limit"),
    )
    taken: dict[str, list[float]] = {name: [] for name in _STARTS}
    bare: list[float] = []
    for _ in range(equipment.extent.starts):
        bare.append(_start_ms(["-c", "pass"]))
        for name, (arguments, _limit) in _STARTS.items():
            taken[name].append(_start_ms(arguments))
    slow = max(slowness(), median(bare) / _QUIET_BARE_MS)
    for name, (_, limit) in _STARTS.items():
        more = median(taken[name]) - median(bare)
        section.rows.append((f"`{name}`", f"{more:.0f}", "" if limit is None else f"{limit:.0f}"))
        if limit is not None:
            section.figures.append(
                Figure(name=f"ms for {name}", value=more, promise=limit, floor=1.5 * limit * slow, better="less")
            )
    return [section]


def _start_ms(arguments: list[str]) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return (time.perf_counter() - began) * 1000
