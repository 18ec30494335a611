"""`drivecomm serve` for 500 virtual drives on 50 lines, four values of each a second, with clients that watch it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from equal_lines import equal_lines
from lines import MeasurementError
from plant_of_50_lines import usage
from report import Figure, Section
from yardstick import slowness

from drivecomm.client import LocalServer, Registration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from equipment import Equipment

LINES, DRIVES, BAUDRATE = 50, 10, 57600
VALUES = ("16-13", "16-14", "16-12")
"""Parameters to poll; the server polls the status in addition."""

_HERE = Path(__file__).parent
_HEAD = '[server]\nhistory = { file = "history.sqlite" }\n[[door]]\nkind = "http"\nlisten = "127.0.0.1:0"'
_LOST_ON_THE_WAY = 0.2
_OWN_SHARE, _MEMORY_MIB = 0.2, 200.0
_CROWD, _IDLE, _STOPS = 900, 100, 25


@dataclass(frozen=True, slots=True, kw_only=True)
class _Served:
    seen: dict[str, Any]
    seconds: float
    polls: int
    missed: int
    processor_s: float
    memory_mib: float


def measure(equipment: Equipment) -> list[Section]:
    """Poll the plant without a server, with a server, and with a server that many clients watch."""
    seconds = equipment.extent.plant_seconds
    with TemporaryDirectory(prefix="dc") as folder, ExitStack() as stack:
        path = Path(folder) / "plant.toml"
        path.write_text(plant_text(LINES), encoding="utf-8")
        command = [sys.executable, "-m", "drivecomm", "simulate", str(path), "--json"]
        simulated = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(simulated.terminate)
        told = json.loads((simulated.stdout.readline() if simulated.stdout else "") or "null")
        if told is None:
            raise MeasurementError("the plant did not start; its reason is on standard error")
        path.write_text(plant_text([line["listening"] for line in told["lines"]]), encoding="utf-8")
        alone = _polled(path, seconds)
        calm = _served(path, Path(folder), seconds, readers=1, idle=0)
        crowd = _served(path, Path(folder), seconds, readers=_CROWD, idle=_IDLE)
    wanted = LINES * DRIVES * (len(VALUES) + 1)
    per_read = alone["processor_s"] / max(1, alone["reads"])
    own = (calm.processor_s - per_read * calm.polls) / calm.seconds
    share = calm.polls / calm.seconds / wanted
    section = Section(
        title="A served plant",
        about=(
            f"`drivecomm serve` with {LINES * DRIVES} virtual drives on {LINES} lines of {BAUDRATE} baud, which "
            f"`drivecomm simulate` serves on the same machine: {len(VALUES)} values and the status of each a second. "
            "Alone: the values by `poll_async` in a process without a server. Calm: one stream with all values, one "
            f"page, and metrics scraped each five seconds. Crowd: {_CROWD} streams more, of which each wants two "
            f"drives once a second, and {_IDLE} of everything that never read. Age: from the last byte of a reply to "
            "whoever reads the stream. Stop: from the client's order to its confirmation, which takes an exchange."
        ),
        head=("", "reads/s", "of those wanted", "missed", "of a core", "memory, MiB", "age p50, ms", "age p99, ms",
              "stop p50, ms", "p90", "longest"),
        rows=[
            ("alone", f"{alone['reads'] / alone['seconds']:.0f}", "", "",
             f"{alone['processor_s'] / alone['seconds']:.2f}", "", f"{1000 * alone['p50_s']:.1f}",
             f"{1000 * alone['p99_s']:.1f}", "", "", ""),
            _row("calm", calm, wanted),
            _row("crowd", crowd, wanted),
        ],
    )  # fmt: skip
    slow = slowness()
    section.figures = [
        Figure(name="served: share of the values wanted", value=share, promise=0.97, floor=0.95 / slow),
        Figure(name="served: of a core beyond polling", value=own, promise=_OWN_SHARE / 2, floor=_OWN_SHARE * slow,
               better="less"),
        Figure(name="served: memory in MiB", value=calm.memory_mib, promise=150, floor=_MEMORY_MIB, better="less"),
        Figure(name="served: age of a value p50 in ms", value=1000 * calm.seen["p50_s"], promise=3, floor=3 * slow,
               better="less"),
        Figure(name="served: age of a value p99 in ms", value=1000 * calm.seen["p99_s"], promise=25, floor=25 * slow,
               better="less"),
        Figure(name="served to a crowd: share of the values wanted", value=crowd.polls / crowd.seconds / wanted,
               promise=0.95, floor=0.95 * share / slow),
        Figure(name="served to a crowd: median stop in ms beyond a calm one", promise=10, floor=20 * slow,
               better="less", value=1000 * (crowd.seen["stops_s"][_STOPS // 2] - calm.seen["stops_s"][_STOPS // 2])),
    ]  # fmt: skip
    return [section]


def _row(name: str, one: _Served, wanted: int) -> tuple[str, ...]:
    stops = one.seen["stops_s"] or [0.0]
    return (
        name,
        f"{one.polls / one.seconds:.0f}",
        f"{one.polls / one.seconds / wanted:.3f}",
        str(one.missed),
        f"{one.processor_s / one.seconds:.2f}",
        f"{one.memory_mib:.0f}",
        f"{1000 * one.seen['p50_s']:.1f}",
        f"{1000 * one.seen['p99_s']:.1f}",
        f"{1000 * stops[len(stops) // 2]:.0f}",
        f"{1000 * stops[int(0.9 * len(stops))]:.0f}",
        f"{1000 * stops[-1]:.0f}",
    )


def plant_text(ports: Sequence[str] | int) -> str:
    """Return the text of the plant file, see `equal_lines`."""
    parameters = ", ".join(f'"{each}"' for each in VALUES)
    poll, line = f"parameters = [{parameters}]", f"baudrate = {BAUDRATE}"
    return equal_lines(_HEAD, ports, drives=DRIVES, poll=poll, line=line)


def _polled(path: Path, seconds: float) -> dict[str, Any]:
    script = _HERE / "polling_process.py"
    done = subprocess.run(
        [sys.executable, str(script), str(path), str(seconds)],
        stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _served(path: Path, folder: Path, seconds: float, *, readers: int, idle: int) -> _Served:
    """Serve the plant for clients; return the clients' observations and the server's usage."""
    state, runtime = folder / "state", folder / "run"
    for each in (state, runtime):
        each.mkdir(mode=0o700, exist_ok=True)
    environment = {**os.environ, "STATE_DIRECTORY": str(state), "XDG_RUNTIME_DIR": str(runtime)}
    with ExitStack() as stack:
        command = [
            sys.executable,
            "-m",
            "drivecomm",
            "serve",
            str(path),
            "--json",
            "--level",
            "error",
        ]
        server = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
        stack.callback(server.terminate)
        told = json.loads((server.stdout.readline() if server.stdout else "") or "null")
        if told is None:
            raise MeasurementError("the server did not start; its reason is on standard error")
        place = told["doors"][0].partition(" ")[2]
        script = [sys.executable, str(_HERE / "server_clients.py"), place]
        clients = stack.enter_context(
            subprocess.Popen(script, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
        stack.callback(clients.terminate)
        if clients.stdin is None or clients.stdout is None:
            raise MeasurementError("a process has no pipes")
        asked = {"seconds": seconds, "readers": readers, "idle": idle}
        clients.stdin.write(json.dumps(asked) + "\n")
        clients.stdin.flush()
        clients.stdout.readline()
        began, before, first = time.monotonic(), usage(server.pid), _lines(told["socket"])
        stops = _stops(told["socket"], seconds)
        seen = json.loads(clients.stdout.readline() or "null")
        if seen is None:
            raise MeasurementError("the clients of the server ended; their reason is on standard error")
        took, after, last = time.monotonic() - began, usage(server.pid), _lines(told["socket"])
    return _Served(
        seen={**seen, "stops_s": stops},
        seconds=took,
        polls=last[0] - first[0],
        missed=last[1] - first[1],
        processor_s=after.processor_s - before.processor_s,
        memory_mib=after.memory_mib,
    )


def _stops(socket: str, seconds: float) -> list[float]:
    """Stop drives now and then for most of this time; return the seconds until each stop was confirmed."""
    server, took = LocalServer(Registration(plant="", socket=socket)), []
    for number in range(_STOPS):
        time.sleep(0.7 * seconds / _STOPS)
        began = time.perf_counter()
        answer = server.order(f"/api/v1/drives/d{number}-1/stop", {"id": ""})
        took.append(time.perf_counter() - began)
        if answer["outcome"] != "done":
            raise MeasurementError(f"a stop was not confirmed: {answer}")
    server.close()
    return sorted(took)


def _lines(socket: str) -> tuple[int, int]:
    """Return the number of reads that the server has made, and the number it has skipped for lack of time."""
    server = LocalServer(Registration(plant="", socket=socket))
    lines = server.ask("/api/v1/plant")["lines"]
    server.close()
    return sum(line["polls"] for line in lines), sum(line["missed"] for line in lines)
