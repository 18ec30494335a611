"""Stops of drives of an open plant: all lines concurrently, so that a dead line delays no other line."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.bus import StopResult, carry_out, stopping_all

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.bus import BlockingLine, OnResult
    from drivecomm.protocol import DriveConfig, Stop

StopOnLine: TypeAlias = "Callable[[BlockingLine, Sequence[DriveConfig], Stop, OnResult | None], list[StopResult]]"
"""Function that stops drives of a line and returns all results."""


def stop_everything(
    bus: BlockingLine, drives: Sequence[DriveConfig], how: Stop, on_result: OnResult | None
) -> list[StopResult]:
    """Stop all drives of a line, by broadcasts and one by one."""
    return bus.stop_all(how, drives=drives, on_result=on_result)


def stop_only(
    bus: BlockingLine, drives: Sequence[DriveConfig], how: Stop, on_result: OnResult | None
) -> list[StopResult]:
    """Stop only these drives of a line, without any broadcast."""
    return carry_out(None, stopping_all(bus, drives, how, on_result, by_name=True))


def stop_lines(
    stop: StopOnLine,
    lines: Mapping[str, Sequence[DriveConfig]],
    bus_of: Callable[[str], BlockingLine],
    how: Stop,
    on_result: OnResult | None,
) -> list[StopResult]:
    """Stop drives of these lines, and return all results. bus_of: opens a line."""
    with ThreadPoolExecutor(max_workers=max(1, len(lines)), thread_name_prefix="drivecomm stop") as threads:
        stopping = [
            threads.submit(_stop_line, stop, drives, partial(bus_of, name), how, on_result)
            for name, drives in lines.items()
        ]
        return [each for line in stopping for each in line.result()]


def _stop_line(
    stop: StopOnLine,
    drives: Sequence[DriveConfig],
    opened: Callable[[], BlockingLine],
    how: Stop,
    on_result: OnResult | None,
) -> list[StopResult]:
    try:
        bus = opened()
    except Exception as error:  # noqa: BLE001 - any error of a line is reported for each of its drives
        results = [StopResult(line=each.line, drive=each.name, how=how, error=error) for each in drives]
        if on_result is not None:
            for result in results:
                on_result(result)
        return results
    return stop(bus, drives, how, on_result)
