"""A plant's poll plan without a server: python polling_process.py PLANT SECONDS; prints the results as JSON.

It measures the minimum work of any server, and the age of values for a reader in the same event loop.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from pathlib import Path
from statistics import median

from drivecomm.bus import open_bus_async
from drivecomm.line import poll_async
from drivecomm.plant import read_plant

_WARM_UP_S = 3.0


async def main(path: Path, seconds: float) -> None:
    """Poll for this many seconds, and print the results."""
    plant = read_plant(path)
    plan = plant.poll_plan()
    buses = {port: open_bus_async(port) for port in plan.lines}
    for bus in buses.values():
        await bus.__aenter__()
    items = plan.items(lambda drive: drive.build(buses[drive.line].drive))
    began, spent, count, ages = 0.0, 0.0, 0, []
    begin = time.monotonic()
    async for result in poll_async(items, duration_s=seconds + _WARM_UP_S):
        if not began:
            if time.monotonic() - begin < _WARM_UP_S:
                continue
            began, spent = time.monotonic(), time.process_time()
        count += result.error is None
        if result.reading is not None:
            ages.append(time.time() - result.reading.time_s)
    spent, took = time.process_time() - spent, time.monotonic() - began
    ages.sort()
    figures = {"p50_s": median(ages), "p99_s": ages[int(0.99 * len(ages))]}
    print(json.dumps({"reads": count, "seconds": took, "processor_s": spent, **figures}))


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), float(sys.argv[2])))
