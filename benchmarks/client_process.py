"""Python master in a separate process: takes jobs as lines of JSON, and answers each with its results."""

from __future__ import annotations

import asyncio
import importlib
import json
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

from bare_lines import read_bare_lines
from bare_reader import LostReplyError, read_bare
from counting import WARM_UP, count_awaited, in_threads, in_turn

import drivecomm
from drivecomm.commissioning import tune
from drivecomm.link import CAREFUL_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from counting import Counts, Job

_NAMELESS = ("vlt3500",)
"""Protocols whose replies do not identify their request."""


def blocking(job: Job) -> tuple[Counts, float]:
    """Read with the blocking API on one line."""
    (path,) = job["paths"]
    with drivecomm.open_bus(path, baudrate=job["baudrate"], **job["options"]) as bus:
        drive = bus.drive(job["protocol"], 1)
        parameter = job["parameter"]
        drive.read(parameter)
        time.sleep(_listened_out_s(job))
        return in_turn(lambda: drive.read(parameter), job["seconds"])


def _listened_out_s(job: Job) -> float:
    """Return how long a newly opened terminal is listened to for old replies, so that measuring starts later."""
    return CAREFUL_S if job["protocol"] in _NAMELESS else 0.0


def tuned(job: Job) -> tuple[Counts, float]:
    """Tune the drive of a line, then read with the blocking API."""
    (path,) = job["paths"]
    with drivecomm.open_bus(path, baudrate=job["baudrate"], **job["options"]) as bus:
        found = tune(bus.drive(job["protocol"], 1))
        if found.error:
            raise drivecomm.NoReplyError(found.error)
        drive = bus.drive(job["protocol"], 1, **found.options)
        parameter = job["parameter"]
        return in_turn(lambda: drive.read(parameter), job["seconds"])


def threads(job: Job) -> tuple[Counts, float]:
    """Read with the blocking API, one thread per line."""
    buses = [drivecomm.open_bus(path, baudrate=job["baudrate"], **job["options"]) for path in job["paths"]]
    parameter = job["parameter"]

    def maker(bus: drivecomm.Bus) -> Callable[[], Callable[[], object]]:
        drive = bus.drive(job["protocol"], 1)
        return lambda: lambda: drive.read(parameter)

    try:
        return in_threads([maker(bus) for bus in buses], job["seconds"])
    finally:
        for bus in buses:
            bus.close()


def tasks(job: Job) -> tuple[Counts, float]:
    """Read with the asyncio API, one task per line."""
    return asyncio.run(_tasks(job))


async def _tasks(job: Job) -> tuple[Counts, float]:
    parameter, seconds = job["parameter"], job["seconds"]
    buses = [drivecomm.open_bus_async(path, baudrate=job["baudrate"], **job["options"]) for path in job["paths"]]
    entered = [await bus.__aenter__() for bus in buses]
    try:
        drives = [bus.drive(job["protocol"], 1) for bus in entered]
        await asyncio.gather(*(drive.read(parameter) for drive in drives))
        await asyncio.sleep(_listened_out_s(job))
        for _ in range(WARM_UP):
            await asyncio.gather(*(drive.read(parameter) for drive in drives))
        began = time.process_time()
        counts = await asyncio.gather(*(_count_drive(drive, parameter, seconds) for drive in drives))
        return list(counts), time.process_time() - began
    finally:
        for bus in buses:
            await bus.__aexit__(None, None, None)


async def _count_drive(drive: Any, parameter: str, seconds: float) -> tuple[int, float]:
    return await count_awaited(lambda: drive.read(parameter), seconds)


def poll_plan(job: Job) -> tuple[Counts, float]:
    """Read by a poll plan over all lines, without a pause between the rounds."""
    buses = [drivecomm.open_bus(path, baudrate=job["baudrate"], **job["options"]) for path in job["paths"]]
    try:
        drives = [bus.drive(job["protocol"], 1) for bus in buses]
        items = [drivecomm.PollItem(drive=drive, parameter=job["parameter"], period_s=0) for drive in drives]
        counted = dict.fromkeys(map(id, items), (0, 0.0))
        for _ in drivecomm.poll(items, cycles=WARM_UP):
            pass
        began, spent = time.perf_counter(), time.process_time()
        for result in drivecomm.poll(items, duration_s=job["seconds"]):
            if result.error is not None:
                raise result.error
            item = id(result.item)
            counted[item] = (counted[item][0] + 1, time.perf_counter() - began)
        return list(counted.values()), time.process_time() - spent
    finally:
        for bus in buses:
            bus.close()


def scan(job: Job) -> tuple[Counts, float]:
    """Scan all lines concurrently; a count is the number of drives found, its seconds are those of the whole scan."""
    buses = [drivecomm.open_bus(path, baudrate=job["baudrate"], **job["options"]) for path in job["paths"]]
    counts: Counts = [(0, 0.0)] * len(buses)

    def work(place: int) -> None:
        began = time.perf_counter()
        found = list(buses[place].scan([job["protocol"]], range(1, 32)))
        counts[place] = (sum(one.sound for one in found), time.perf_counter() - began)

    running = [threading.Thread(target=work, args=(place,)) for place in range(len(buses))]
    began = time.process_time()
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    spent = time.process_time() - began
    for bus in buses:
        bus.close()
    return counts, spent


def peer(job: Job) -> tuple[Counts, float]:
    """Read with a Modbus library."""
    try:
        clients = importlib.import_module("peer_clients")
    except ImportError as error:
        raise MissingError(
            f"{error.name} is not installed, so no Modbus library is measured; install the extra: bench"
        ) from None
    try:
        result: tuple[Counts, float] = clients.WAYS[job["way"]](job)
    except Exception as error:
        # Each library raises its own errors for a missing reply.
        raise drivecomm.NoReplyError(f"{type(error).__name__}: {error}") from error
    return result


class MissingError(Exception):
    """A requirement of a job is missing."""


WAYS = {
    "bare Python": read_bare,
    "bare selectors": read_bare_lines,
    "blocking": blocking,
    "tuned": tuned,
    "threads": threads,
    "asyncio": tasks,
    "poll plan": poll_plan,
    "scan": scan,
}


def compute(stop: threading.Event) -> None:
    """Compute without waiting until the event is set, as a busy neighbour thread."""
    number = 0
    while not stop.is_set():
        for number in range(1000):
            number * number


def do(job: Job) -> tuple[Counts, float]:
    """Do one job."""
    way = WAYS.get(job["way"], peer)
    usual = sys.getswitchinterval()
    stop = threading.Event()
    neighbour = threading.Thread(target=compute, args=(stop,), daemon=True)
    if job["switch_interval_s"] is not None:
        sys.setswitchinterval(job["switch_interval_s"])
    if job["neighbour"]:
        neighbour.start()
    try:
        return way(job)
    finally:
        stop.set()
        sys.setswitchinterval(usual)


def main() -> None:
    """Do jobs until standard input ends."""
    for line in sys.stdin:
        try:
            counts, processor_s = do(json.loads(line))
        except MissingError as error:
            answer: dict[str, Any] = {"missing": str(error)}
        except (drivecomm.DriveCommError, LostReplyError) as error:
            answer = {"failed": f"{type(error).__name__}: {error}"}
        except Exception as error:  # noqa: BLE001 - reported to the sender of the job
            answer = {"broken": f"{type(error).__name__}: {error}"}
        else:
            lines = [{"exchanges": number, "seconds": seconds} for number, seconds in counts]
            answer = {"lines": lines, "processor_s": processor_s}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
