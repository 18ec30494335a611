"""Assignment of processor cores: the emulator spins on one, and the measured program runs on another."""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
from pathlib import Path

import drivecomm

_PROCESSES = Path("/proc")
# Index of the parent in a process's stat file, counted from its state; the ancestor of all kernel threads.
_PARENT, _KERNEL = 1, "2"


def on_emulator_core() -> list[str]:
    """Return the start of a command line that runs a program on the emulator's core."""
    return _on(-1)


def on_client_core() -> list[str]:
    """Return the start of a command line that runs a program on the core of the measured program."""
    return _on(0)


def machine() -> str:
    """Return a one-line description of this machine."""
    cores = sorted(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    return (
        f"drivecomm {drivecomm.__version__}, {platform.python_implementation()} {platform.python_version()}, "
        f"{platform.system()} {platform.release()}, {platform.machine()}, {len(cores)} cores, "
        f"load {load:.1f} before the run"
    )


def others_s(child: int) -> float:
    """Return the processor time in seconds that other programs have used so far.

    Other means: not this process, its ended children, or this child.

    The kernel's own threads are not counted, because they carry the characters of pseudo-terminals.
    """
    user, nice, system, _, _, *interrupts = (int(field) for field in _fields("stat", 1, 9))
    ticks = user + nice + system + sum(interrupts) - _used(_fields(f"{child}/stat"))
    for process in _PROCESSES.glob("[0-9]*/stat"):
        # Some processes end during the count.
        with contextlib.suppress(OSError):
            fields = _fields(str(process))
            ticks -= _used(fields) if fields[_PARENT] == _KERNEL else 0
    return ticks / os.sysconf("SC_CLK_TCK") - sum(os.times()[:4])


def _fields(name: str, first: int = 0, last: int | None = None) -> list[str]:
    """Return fields of a file's first line after the name of the process, which may contain spaces."""
    with (_PROCESSES / name).open(encoding="utf-8", errors="replace") as file:
        return file.readline().rpartition(")")[2].split()[first:last]


def _used(fields: list[str]) -> int:
    return int(fields[11]) + int(fields[12])


def _on(place: int) -> list[str]:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) == 1 or shutil.which("taskset") is None:
        return []
    return ["taskset", "-c", str(cores[place])]
