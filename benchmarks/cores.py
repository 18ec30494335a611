"""Which processor core runs what: the emulator spins on one, what is measured runs on another."""

from __future__ import annotations

import os
import platform
import shutil
from pathlib import Path

import drivecomm

_PROCESSES = Path("/proc")


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
    """Return the processor time used so far by all but this process, its children that ended, and this child."""
    user, nice, system, _, _, *interrupts = (int(field) for field in _first_line("stat").split()[1:9])
    used = _first_line(f"{child}/stat").rpartition(")")[2].split()[11:13]
    ticks = user + nice + system + sum(interrupts) - sum(int(part) for part in used)
    return ticks / os.sysconf("SC_CLK_TCK") - sum(os.times()[:4])


def _first_line(name: str) -> str:
    with (_PROCESSES / name).open(encoding="utf-8") as file:
        return file.readline()


def _on(place: int) -> list[str]:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) == 1 or shutil.which("taskset") is None:
        return []
    return ["taskset", "-c", str(cores[place])]
