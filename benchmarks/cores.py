"""Which processor core runs what: the emulator spins on one, what is measured runs on another."""

from __future__ import annotations

import os
import platform
import shutil
from pathlib import Path

import drivecomm

_SCHEDULED = Path("/proc/self/schedstat")


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


def waited_s() -> float:
    """Return how long this process's main thread waited for its core so far; zero where the system does not say."""
    try:
        _, waited_ns, _ = _SCHEDULED.read_text(encoding="utf-8").split()
    except OSError:
        return 0.0
    return int(waited_ns) / 1e9


def _on(place: int) -> list[str]:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) == 1 or shutil.which("taskset") is None:
        return []
    return ["taskset", "-c", str(cores[place])]
