"""How quick this machine is just now: the cost of a small piece of Python that never changes.

Figures in microseconds, or a second, are promised for a machine that has nothing else to do. Where a machine is slower,
or shared, the yardstick is longer in the same run, and the floors of such figures are moved by as much.
"""

from __future__ import annotations

import time

# One telegram taken apart, checked and put together by hand; CPython 3.11 on an undisturbed core of the machine that
# the promises were made for.
_QUIET_US = 1.5
_CALLS = 1000
_BATCHES = 15


def slowness() -> float:
    """Return how many times longer the yardstick takes now than on the quiet machine, at least 1."""
    telegram = bytes(range(14))
    taken = []
    for _ in range(_BATCHES):
        began = time.process_time()
        for _ in range(_CALLS):
            _by_hand(telegram)
        taken.append((time.process_time() - began) / _CALLS * 1e6)
    return max(1.0, sorted(taken)[_BATCHES // 2] / _QUIET_US)


def _by_hand(telegram: bytes) -> bytes:
    check = 0
    for byte in telegram[:13]:
        check ^= byte
    word = int.from_bytes(telegram[2:4], "big")
    value = int.from_bytes(telegram[4:8], "big")
    return bytes([2, 12]) + word.to_bytes(2, "big") + value.to_bytes(4, "big") + telegram[8:13] + bytes([check])
