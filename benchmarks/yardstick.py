"""Yardstick for the present speed of this machine: the cost of small pieces of Python that never change.

Figures in microseconds, or per second, are promised for an idle machine. On a slower or shared machine the yardstick
takes longer in the same run, and the floors of such figures are moved by the same factor.
"""

from __future__ import annotations

import time
from statistics import median

# One telegram parsed, checked and rebuilt by hand; CPython 3.11 on an undisturbed core of the machine for which the
# promises were made.
_QUIET_US = 1.5
# One exchange of the bare Python master with telegrams of 14 bytes at 115200 baud, on the same undisturbed machine.
_QUIET_WAKING_US = 40.0
_CALLS = 1000
_BATCHES = 15


def slowness() -> float:
    """Return the present duration of the yardstick relative to the undisturbed machine, at least 1."""
    return max(1.0, median(_batches()) / _QUIET_US)


def yardstick_us() -> float:
    """Return the processor time of the yardstick in microseconds; the minimum of several batches."""
    return min(_batches())


def waking_slowness(bare_us: float) -> float:
    """Return the slowdown of a Python process that has just been woken, at least 1.

    bare_us: processor time of one exchange of the bare Python master. While a process sleeps, its data leaves the
    processor's caches. On a machine shared with other tenants, the work after waking then costs several times the work
    in a loop without pauses.
    """
    return max(1.0, bare_us / _QUIET_WAKING_US)


def _batches() -> list[float]:
    telegram = bytes(range(14))
    taken = []
    for _ in range(_BATCHES):
        began = time.process_time()
        for _ in range(_CALLS):
            _by_hand(telegram)
        taken.append((time.process_time() - began) / _CALLS * 1e6)
    return taken


def _by_hand(telegram: bytes) -> bytes:
    check = 0
    for byte in telegram[:13]:
        check ^= byte
    word = int.from_bytes(telegram[2:4], "big")
    value = int.from_bytes(telegram[4:8], "big")
    return bytes([2, 12]) + word.to_bytes(2, "big") + value.to_bytes(4, "big") + telegram[8:13] + bytes([check])
