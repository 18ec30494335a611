"""Processor time of the import, of a first read, and of the command line, beyond the exchange itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from lines import MeasurementError
from report import Figure, Section
from yardstick import slowness

from drivecomm.client import server_of_plant

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from equipment import Equipment

_PROGRAM = """
import sys, drivecomm
with drivecomm.open_bus(sys.argv[1]) as bus:
    bus.drive("vabus", address=1).read("481")
"""
_COMMAND = ("-m", "drivecomm")
_STARTS: Mapping[str, tuple[Sequence[str], float | None]] = {
    "import drivecomm": (("-c", "import drivecomm"), 55.0),
    "a program that opens a port and reads": (("-c", _PROGRAM, "PORT"), 130.0),
    "drivecomm --version": ((*_COMMAND, "--version"), 60.0),
    "drivecomm read": ((*_COMMAND, "read", "--port", "PORT", "vabus:1", "481"), 225.0),
    "drivecomm stop": ((*_COMMAND, "stop", "--port", "PORT", "vabus:1"), 225.0),
    "drivecomm read, through a server": ((*_COMMAND, "read", "--plant", "PLANT", "pump", "481"), 150.0),
    "drivecomm stop, through a server": ((*_COMMAND, "stop", "--plant", "PLANT", "pump"), 150.0),
    "drivecomm --help": ((*_COMMAND, "--help"), None),
    "drivecomm protocols": ((*_COMMAND, "protocols"), None),
}
"""Arguments of the interpreter, and the limit in milliseconds."""

_PLANT = """\
format = 1
[[line]]
name = "hall"
port = "{port}"
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
"""

# Time of a bare interpreter on the undisturbed machine for which the limits were set.
_QUIET_BARE_MS = 12.0

_READY_WITHIN_S = 15.0


def measure(equipment: Equipment) -> list[Section]:
    """Measure each start relative to a bare interpreter in the same run."""
    section = Section(
        title="Start-up",
        about="Milliseconds of processor time over a bare interpreter, the least of interleaved starts.",
        head=("what", "ms more", "limit"),
    )
    taken: dict[str, list[float]] = {name: [] for name in _STARTS}
    bare: list[float] = []
    with TemporaryDirectory() as folder:
        script = Path(__file__).with_name("serving_process.py")
        serving = [sys.executable, str(script), "vabus", "2", folder]
        with subprocess.Popen(serving, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            if process.stdin is None or process.stdout is None:
                raise MeasurementError("the server has no pipes")
            port, served_port = json.loads(process.stdout.readline())
            with _served(Path(folder) / "plant.toml", served_port) as plant:
                places = {"PORT": port, "PLANT": str(plant)}
                for _ in range(equipment.extent.starts):
                    bare.append(_processor_ms(["-I", "-c", "pass"]))
                    for name, (arguments, _) in _STARTS.items():
                        taken[name].append(_processor_ms([places.get(each, each) for each in arguments]))
            process.stdin.close()
    slow = max(slowness(), min(bare) / _QUIET_BARE_MS)
    for name, (_, limit) in _STARTS.items():
        more = min(taken[name]) - min(bare)
        section.rows.append((f"`{name}`", f"{more:.0f}", "" if limit is None else f"{limit:.0f}"))
        if limit is not None:
            figure = Figure(name=f"ms for {name}", value=more, promise=limit, floor=limit * slow, better="less")
            section.figures.append(figure)
    return [section]


@contextmanager
def _served(plant: Path, port: str) -> Iterator[Path]:
    """Serve a plant of one line in a separate process; yield the plant file."""
    plant.write_text(_PLANT.format(port=port))
    with subprocess.Popen([sys.executable, *_COMMAND, "serve", str(plant)], stdout=subprocess.DEVNULL) as server:
        try:
            until = time.monotonic() + _READY_WITHIN_S
            while server_of_plant(plant) is None:
                if time.monotonic() > until or server.poll() is not None:
                    raise MeasurementError("the server does not come up")
                time.sleep(0.05)
            yield plant
        finally:
            server.terminate()


def _processor_ms(arguments: Sequence[str]) -> float:
    """Return the processor time of a process from start to end in milliseconds."""
    nowhere = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    process = os.posix_spawn(sys.executable, [sys.executable, *arguments], os.environ, file_actions=nowhere)
    _, status, usage = os.wait4(process, 0)
    if status:
        raise MeasurementError(f"python {' '.join(arguments)} failed")
    return (usage.ru_utime + usage.ru_stime) * 1000
