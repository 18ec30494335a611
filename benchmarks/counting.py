"""Counting of a master's reads, in one thread, in many, or in tasks."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

Counts: TypeAlias = "list[tuple[int, float]]"
"""Exchanges and seconds of each line."""

Job: TypeAlias = "dict[str, Any]"

WARM_UP = 2
"""Number of first reads that are not counted."""


def count(read: Callable[[], object], seconds: float) -> tuple[int, float]:
    """Repeat a read for this time; return the number of reads, and the seconds until the end of the last one."""
    began = ended = time.perf_counter()
    number = 0
    while ended - began < seconds:
        read()
        number += 1
        ended = time.perf_counter()
    return number, ended - began


async def count_awaited(read: Callable[[], Awaitable[object]], seconds: float) -> tuple[int, float]:
    """Repeat an awaited read for this time; return the number of reads and the seconds, as `count` does."""
    began = ended = time.perf_counter()
    number = 0
    while ended - began < seconds:
        await read()
        number += 1
        ended = time.perf_counter()
    return number, ended - began


def in_threads(makers: Sequence[Callable[[], Callable[[], object]]], seconds: float) -> tuple[Counts, float]:
    """Read with one thread per line; return the counts and the processor time from a common start."""
    start = threading.Barrier(len(makers) + 1)
    counts: Counts = [(0, 0.0)] * len(makers)
    failures: list[Exception] = []

    def work(place: int) -> None:
        try:
            read = makers[place]()
            for _ in range(WARM_UP):
                read()
            start.wait(30)
            counts[place] = count(read, seconds)
        except Exception as error:  # noqa: BLE001 - raised where the threads were started
            failures.append(error)
            start.abort()

    threads = [threading.Thread(target=work, args=(place,)) for place in range(len(makers))]
    for thread in threads:
        thread.start()
    with contextlib.suppress(threading.BrokenBarrierError):
        start.wait(30)
    began = time.process_time()
    for thread in threads:
        thread.join()
    # Real errors first: a broken barrier only means that another thread failed.
    for failure in sorted(failures, key=lambda error: isinstance(error, threading.BrokenBarrierError)):
        raise failure
    return counts, time.process_time() - began


def in_turn(read: Callable[[], object], seconds: float) -> tuple[Counts, float]:
    """Read on one line in this thread; return the counts and the processor time."""
    for _ in range(WARM_UP):
        read()
    began = time.process_time()
    counted = count(read, seconds)
    return [counted], time.process_time() - began
