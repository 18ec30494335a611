"""Which processor core runs what: the emulator spins on one, what is measured runs on another."""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
from pathlib import Path

import drivecomm

_PROCESSES = Path("/proc")
# In a process's stat file, from its state on; the process that all kernel threads descend from.
_PARENT, _KERNEL = 1, "2"


def on_emulator_core() -> list[str]:
    """Return the beginning of a command that runs on the emulator's core."""
    return _on(-1)


def on_client_core() -> list[str]:
    """Return the beginning of a command that runs on the core of what is measured."""
    return _on(0)


def machine() -> str:
    """Return what a reader must know of this machine, in one line."""
    cores = sorted(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    return (
        f"drivecomm {drivecomm.__version__}, {platform.python_implementation()} {platform.python_version()}, "
        f"{platform.system()} {platform.release()}, {platform.machine()}, {len(cores)} cores, "
        f"load {load:.1f} before the run"
    )


def others_s(child: int) -> float:
    """Return the processor time used so far by all but this process, its children that ended, this child, and Linux.

    The kernel's own threads carry the characters of pseudo-terminals.
    """
    user, nice, system, _, _, *interrupts = (int(field) for field in _fields("stat", 1, 9))
    ticks = user + nice + system + sum(interrupts) - _used(_fields(f"{child}/stat"))
    for process in _PROCESSES.glob("[0-9]*/stat"):
        # Some end while they are counted.
        with contextlib.suppress(OSError):
            fields = _fields(str(process))
            ticks -= _used(fields) if fields[_PARENT] == _KERNEL else 0
    return ticks / os.sysconf("SC_CLK_TCK") - sum(os.times()[:4])


def _fields(name: str, first: int = 0, last: int | None = None) -> list[str]:
    """Return fields of a file's first line, behind the name of the process, which may have spaces."""
    with (_PROCESSES / name).open(encoding="utf-8", errors="replace") as file:
        return file.readline().rpartition(")")[2].split()[first:last]


def _used(fields: list[str]) -> int:
    return int(fields[11]) + int(fields[12])


def _on(place: int) -> list[str]:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) == 1 or shutil.which("taskset") is None:
        return []
    return ["taskset", "-c", str(cores[place])]
