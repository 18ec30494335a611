"""Fuzzing without atheris: seeded random mutations of the seeds, without coverage or further packages."""

from __future__ import annotations

from random import Random
from time import perf_counter
from typing import TYPE_CHECKING

from outcome import Flaw, FuzzResult, kind_of, peak_mib, store_input

if TYPE_CHECKING:
    from collections.abc import Iterator

    from target import FuzzTarget

TITLE = "the plain random mutator, which sees no coverage"
# Growth beyond this limit cannot be the interpreter's own, and indicates a leak.
_MOST_GROWTH_MIB = 256
_SHRINKING_TRIALS = 400


def run(target: FuzzTarget, *, runs: int | None, seconds: float | None, seed: int) -> FuzzResult:
    """Run a target on its seeds, on the inputs found before, and on mutations of both, up to a limit."""
    before, began, slowest, number = peak_mib(), perf_counter(), 0.0, 0
    flaws: dict[tuple[str, str], Flaw] = {}
    check, at = target.check, began
    for data in _inputs(target, Random(seed)):  # noqa: S311 - repeatable on purpose
        try:
            check(data)
        except Exception as error:  # noqa: BLE001 - any exception is a finding
            known = kind_of(error)
            if known not in flaws:
                flaws[known] = _flaw(target, data, known)
                at = perf_counter()
        number += 1
        now = perf_counter()
        slowest, at = max(slowest, now - at), now
        if number == runs or (seconds is not None and now - began >= seconds):
            break
        if not number % 4096 and peak_mib() - before > _MOST_GROWTH_MIB:
            flaws["memory", ""] = Flaw(error="memory grows without end", place="", kept=store_input(target, data))
            break
    return FuzzResult(
        target=target.name,
        inputs=number,
        seconds=perf_counter() - began,
        flaws=tuple(flaws.values()),
        grown_mib=peak_mib() - before,
        slowest_s=slowest,
    )


def _inputs(target: FuzzTarget, random: Random) -> Iterator[bytes]:
    known = [*target.seeds, *target.found()]
    yield b""
    yield from known
    mutate, choose, size = target.mutate, random.random, len(known)
    while True:
        yield mutate(random, known[int(choose() * size)], known)


def _flaw(target: FuzzTarget, data: bytes, known: tuple[str, str]) -> Flaw:
    data, error = _shrunk(target, data, known)
    return Flaw(error=f"{type(error).__name__}: {str(error)[:200]}", place=known[1], kept=store_input(target, data))


def _shrunk(target: FuzzTarget, data: bytes, known: tuple[str, str]) -> tuple[bytes, BaseException]:
    """Return the smallest input found that still reveals the same flaw, with its error."""
    error = _error(target, data) or RuntimeError("it does not come again")
    # Shrinking a deep recursion could make it too shallow to fail with another engine.
    if data in target.found() or isinstance(error, RecursionError):
        return data, error
    size, trials = len(data) // 2, 0
    while size and trials < _SHRINKING_TRIALS:
        start = 0
        while start < len(data) and trials < _SHRINKING_TRIALS:
            trials += 1
            shorter = data[:start] + data[start + size :]
            found = _error(target, shorter)
            if found is not None and kind_of(found) == known:
                data, error = shorter, found
            else:
                start += size
        size //= 2
    return data, error


def _error(target: FuzzTarget, data: bytes) -> BaseException | None:
    try:
        target.check(data)
    except Exception as error:  # noqa: BLE001 - as above
        return error
    return None
