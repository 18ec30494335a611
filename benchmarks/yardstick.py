"""How quick this machine is just now: the cost of small pieces of Python that never change.

Figures in microseconds, or a second, are promised for a machine that has nothing else to do. Where a machine is slower,
or shared, the yardstick is longer in the same run, and the floors of such figures are moved by as much.
"""

from __future__ import annotations

import time
from statistics import median

# One telegram taken apart, checked and put together by hand; CPython 3.11 on an undisturbed core of the machine that
# the promises were made for.
_QUIET_US = 1.5
# One exchange of the bare Python master with telegrams of 14 bytes at 115200 baud, on the same machine when quiet.
_QUIET_WAKING_US = 40.0
_CALLS = 1000
_BATCHES = 15


def slowness() -> float:
    """Return how many times longer the yardstick takes now than on the quiet machine, at least 1."""
    return max(1.0, median(_batches()) / _QUIET_US)


def yardstick_us() -> float:
    """Return the processor time of the yardstick, the least of some batches."""
    return min(_batches())


def waking_slowness(bare_us: float) -> float:
    """Return how many times longer a Python process that was just woken takes for its work, at least 1.

    bare_us: processor time of one exchange of the bare Python master. A processor that slept, or did other things, has
    forgotten what it knew of the program (its caches), and where other tenants share it that costs several times what
    the work costs when it is repeated without a pause.
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
