"""500 virtual drives on 50 served lines in one process, with a master that sends requests without a pause."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from conversation import READS, record_conversation
from cores import on_client_core, on_emulator_core
from lines import MeasurementError
from report import Figure, Section
from yardstick import slowness

import drivecomm
from drivecomm.plant import read_plant
from drivecomm.virtual import VirtualPlant

if TYPE_CHECKING:
    from equipment import Equipment

    from drivecomm.virtual import VirtualLine

LINES, DRIVES_ON_A_LINE, BAUDRATE = 50, 10, 19200
_TITLE = "A plant of 50 lines"
_SHARE, _LEAST_SHARE = 0.97, 0.95
_OF_CORE, _MOST_OF_CORE = 0.30, 0.45
# If the plant waited for its core for a larger share of the time, the result is void.
_MOST_WAITED = 0.1
_PROCESSES = Path("/proc")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Spoken:
    """Exchanges on a line in turn, with the expected replies. rate: exchanges per second that the wire allows."""

    exchanges: tuple[tuple[bytes, bytes], ...]
    rate: float


@dataclass(frozen=True, slots=True)
class _Usage:
    """Usage of a process: processor time in seconds, seconds that it waited for a core, and resident memory in MiB."""

    processor_s: float
    waited_s: float
    memory_mib: float


def measure(equipment: Equipment) -> list[Section]:
    """Serve the plant with `drivecomm simulate` on one core, and poll it from the other."""
    if not (_PROCESSES / str(os.getpid()) / "schedstat").exists():
        remark = "not measured: this system does not say what another process uses"
        return [Section(title=_TITLE, about="Could not be measured.", head=(), remarks=[remark])]
    seconds = equipment.extent.plant_seconds
    with TemporaryDirectory() as folder:
        path = Path(folder) / "plant.toml"
        path.write_text(_plant(), encoding="utf-8")
        plant = VirtualPlant(read_plant(path))
        spoken = [_spoken_on(plant, f"line {number}", protocol) for number, protocol in _lines()]
        came, before, after = _asked(path, spoken, seconds)
    took = came["seconds"]
    rates = [line["exchanges"] / took for line in came["lines"]]
    exchanges = sum(line["exchanges"] for line in came["lines"])
    lost, wrong = (sum(line[what] for line in came["lines"]) for what in ("lost", "wrong"))
    possible = sum(one.rate for one in spoken)
    share = sum(rates) / possible
    slowest = min(rate / one.rate for rate, one in zip(rates, spoken, strict=True))
    spent, waited = after.processor_s - before.processor_s, after.waited_s - before.waited_s
    section = Section(
        title=_TITLE,
        about=(
            f"`drivecomm simulate` with {LINES * DRIVES_ON_A_LINE} drives of all protocols on {LINES} lines of "
            f"{BAUDRATE} baud with pacing, one process on one core, over TCP. On the other core one process asks on "
            "all lines at once, as soon as it has its answer, and compares each with what the same drive says in "
            "virtual time. possible/s: what the wires have room for with the drives' own delays. Lost: no answer "
            "within a second. Waited for it: how long others had the plant's core while it could have computed."
        ),
        head=(
            "seconds", "possible/s", "exchanges/s", "share", "slowest line", "lost", "wrong", "plant, of a core",
            "waited for it", "us per exchange", "master, of a core", "memory, MiB", "grown, MiB",
        ),
        rows=[
            (
                f"{took:.0f}",
                f"{possible:.0f}",
                f"{exchanges / took:.0f}",
                f"{share:.4f}",
                f"{slowest:.4f}",
                str(lost),
                str(wrong),
                f"{100 * spent / took:.0f} %",
                f"{100 * waited / took:.0f} %",
                f"{spent / max(1, exchanges) * 1e6:.0f}",
                f"{100 * came['processor_s'] / took:.0f} %",
                f"{after.memory_mib:.1f}",
                f"{after.memory_mib - before.memory_mib:.1f}",
            )
        ],
    )  # fmt: skip
    slow = slowness()
    section.figures = [
        Figure(
            name="share of 50 lines' possible",
            value=share,
            promise=_SHARE,
            floor=_LEAST_SHARE / slow,
            disturbed=waited > _MOST_WAITED * took,
        ),
        Figure(
            name="of one core for 50 lines",
            value=spent / took,
            promise=_OF_CORE,
            floor=_MOST_OF_CORE * slow,
            better="less",
            disturbed=waited > _MOST_WAITED * took,
        ),
        Figure(name="lost or wrong on 50 lines", value=lost + wrong, promise=0, floor=0, better="less"),
    ]
    return [section]


def _lines() -> list[tuple[int, str]]:
    return list(enumerate(islice(cycle(READS), LINES)))


def _plant() -> str:
    parts = ["format = 1"]
    for number, protocol in _lines():
        name = f"line {number}"
        parts.append(f'[[line]]\nname = "{name}"\nlisten = "tcp:127.0.0.1:0"\nbaudrate = {BAUDRATE}')
        parts += [
            f'[[drive]]\nname = "{address} on {name}"\ndrive = "{protocol}:{address}"\nline = "{name}"'
            for address in range(1, DRIVES_ON_A_LINE + 1)
        ]
    return "\n\n".join(parts) + "\n"


def _spoken_on(plant: VirtualPlant, name: str, protocol: str) -> _Spoken:
    """Read each drive of a line once in virtual time, and return the exchanges without a master's pauses."""
    line = plant.line(name)
    closing = record_conversation(protocol, BAUDRATE).closing
    events: list[drivecomm.TraceEvent] = []
    with drivecomm.open_bus(line.port, baudrate=BAUDRATE, trace=events.append) as bus:
        for address in range(1, DRIVES_ON_A_LINE + 1):
            bus.drive(protocol, address).read(READS[protocol])
    requests = dict.fromkeys(event.data for event in events if event.what == "sent" and event.data != closing)
    line.advance(1.0)
    line.take()
    began = line.time
    exchanges = [(closing + request, _answer(line, closing + request)) for request in requests]
    return _Spoken(exchanges=tuple(exchanges), rate=len(exchanges) / (line.time - began))


def _answer(line: VirtualLine, request: bytes) -> bytes:
    line.transmit(request)
    while not (heard := line.take()):
        if line.due > line.time + 1:
            raise MeasurementError(f"a virtual drive does not answer {request.hex()}")
        line.pass_time(line.due)
    return heard


def _asked(path: Path, spoken: list[_Spoken], seconds: float) -> tuple[dict[str, Any], _Usage, _Usage]:
    """Serve the plant and poll it; return the results, and the usage of the plant's process before and after."""
    with ExitStack() as stack:
        command = [*on_emulator_core(), sys.executable, "-m", "drivecomm", "simulate", str(path), "--json"]
        plant = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(plant.terminate)
        script = Path(__file__).with_name("asking_process.py")
        master = stack.enter_context(
            subprocess.Popen(
                [*on_client_core(), sys.executable, str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        stack.callback(master.terminate)
        if plant.stdout is None or master.stdin is None or master.stdout is None:
            raise MeasurementError("a process has no pipes")
        served = json.loads(plant.stdout.readline() or "null")
        if served is None:
            raise MeasurementError("the plant did not start; its reason is on standard error")
        places = []
        for line, one in zip(served["lines"], spoken, strict=True):
            host, _, port = line["listening"].removeprefix("socket://").rpartition(":")
            hexadecimal = [(request.hex(), reply.hex()) for request, reply in one.exchanges]
            places.append({"host": host, "port": int(port), "spoken": hexadecimal})
        master.stdin.write(json.dumps({"places": places, "seconds": seconds}) + "\n")
        master.stdin.flush()
        if not master.stdout.readline():
            raise MeasurementError("the master of 50 lines ended; its reason is on standard error")
        before = usage(plant.pid)
        told = master.stdout.readline()
        if not told:
            raise MeasurementError("the master of 50 lines ended; its reason is on standard error")
        return json.loads(told), before, usage(plant.pid)


def usage(process: int) -> _Usage:
    """Return the usage of a process so far."""
    # The schedstat of the whole process covers its first thread only.
    threads = [
        each.read_text(encoding="utf-8").split() for each in (_PROCESSES / str(process)).glob("task/*/schedstat")
    ]
    computed_ns, waited_ns = (sum(int(each[place]) for each in threads) for place in (0, 1))
    pages = int((_PROCESSES / str(process) / "statm").read_text(encoding="utf-8").split()[1])
    return _Usage(computed_ns / 1e9, waited_ns / 1e9, pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
