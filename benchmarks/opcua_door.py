"""How old a changed value is when an OPC UA client that subscribes it has it.

    python benchmarks/opcua_door.py --seconds 20

`drivecomm serve` polls virtual drives of `drivecomm simulate` on the same machine; one value after the other is
changed, and a client of the library asyncua subscribes all of them. Age: from the last byte of a reply, which the
server takes for the source timestamp, to the notification. A server tells changes once in each publishing interval.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asyncua import Client, ua
from equal_lines import equal_lines

from drivecomm.virtual import ControlClient

if TYPE_CHECKING:
    from collections.abc import Sequence

_LINES, _DRIVES, _PARAMETER = 10, 5, "3-10[0]"
_NODE = "drives/{}/Parameters/" + _PARAMETER
_EACH_S = 0.005
_INTERVALS_MS = (50, 100, 250, 1000)


def main() -> None:
    """Measure; print it."""
    parser = argparse.ArgumentParser(description="Measure the OPC UA door.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each publishing interval")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="dc") as name, ExitStack() as stack:
        folder = Path(name)
        path, control = folder / "plant.toml", f"unix:{folder / 'control'}"
        path.write_text(_plant(_LINES), encoding="utf-8")
        told = _started(stack, ["simulate", str(path), "--control", control, "--json"])
        path.write_text(_plant([line["listening"] for line in told["lines"]]), encoding="utf-8")
        door = _started(stack, ["serve", str(path), "--json", "--level", "error"])["doors"][0].split()[1]
        over = threading.Event()
        changing = threading.Thread(target=_change, args=(control, over))
        changing.start()
        try:
            for interval_ms in _INTERVALS_MS:
                ages = sorted(asyncio.run(_ages(f"opc.tcp://{door}", interval_ms, chosen.seconds)))
                p50, p99 = ages[len(ages) // 2], ages[int(0.99 * len(ages))]
                print(
                    f"publishing interval {interval_ms} ms: {len(ages) / chosen.seconds:.0f} changes a second, age p50 "
                    f"{1000 * p50:.1f} ms, p99 {1000 * p99:.1f} ms, longest {1000 * ages[-1]:.1f} ms"
                )
        finally:
            over.set()
            changing.join()


def _plant(ports: Sequence[str] | int) -> str:
    head = '[[door]]\nkind = "opcua"\nlisten = "127.0.0.1:0"'
    poll = f'parameters = ["{_PARAMETER}"], period_s = 0.1'
    return equal_lines(head, ports, drives=_DRIVES, poll=poll, line="paced = false")


def _names(line: int) -> list[str]:
    return [f"d{line}-{number}" for number in range(1, _DRIVES + 1)]


def _started(stack: ExitStack, arguments: list[str]) -> dict[str, Any]:
    """Start drivecomm with these arguments; return what it says first."""
    folder = Path(arguments[1]).parent
    environment = {**os.environ, "STATE_DIRECTORY": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    command = [sys.executable, "-m", "drivecomm", *arguments]
    process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
    stack.callback(process.terminate)
    line = process.stdout.readline() if process.stdout else ""
    if not line:
        raise SystemExit("a process of the measurement ended; its reason is on standard error")
    told: dict[str, Any] = json.loads(line)
    return told


def _change(control: str, over: threading.Event) -> None:
    """Change one value after the other."""
    names, number = [name for line in range(_LINES) for name in _names(line)], 0
    with ControlClient(control) as plant:
        while not over.wait(_EACH_S):
            number += 1
            plant.order("set", drive=names[number % len(names)], parameter=_PARAMETER, value=number % 10_000)


async def _ages(url: str, interval_ms: int, seconds: float) -> list[float]:
    """Return how old values were when they came, in seconds, from the second notification on."""
    ages: list[float] = []

    class Handler:
        def datachange_notification(self, _node: Any, _value: Any, data: Any) -> None:
            ages.append(time.time() - data.monitored_item.Value.SourceTimestamp.timestamp())

        def status_change_notification(self, _status: Any) -> None:
            pass

    async with Client(url, timeout=60) as client:
        subscription = await client.create_subscription(interval_ms, Handler())
        nodes = [client.get_node(ua.NodeId(_NODE.format(name), 2)) for line in range(_LINES) for name in _names(line)]
        await subscription.subscribe_data_change(nodes)
        await asyncio.sleep(1 + interval_ms / 1000)
        ages.clear()
        await asyncio.sleep(seconds)
        return ages


if __name__ == "__main__":
    main()
