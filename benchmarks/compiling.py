"""Compilation of the two C programs for measuring."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

_SOURCES = Path(__file__).with_name("emulator")


_MODULES = ("aiomqtt", "asyncua", "minimalmodbus", "paho", "pymodbus", "starlette", "uvicorn")
"""Modules that the measurements import besides drivecomm; `make bench` installs them."""


class CannotMeasureError(Exception):
    """A requirement of a measurement is missing; the text names it and the remedy."""


@dataclass(frozen=True, slots=True)
class Programs:
    """Paths of the compiled programs."""

    line_emulator: Path
    reference_client: Path


def compile_programs(folder: Path) -> Programs:
    """Compile into a folder with the system's compiler ($CC, cc, gcc or clang). Raises CannotMeasureError."""
    if sys.platform != "linux":
        raise CannotMeasureError("the line emulator needs Linux (epoll, pseudo-terminals); run on a Linux machine")
    if missing := [name for name in _MODULES if find_spec(name) is None]:
        raise CannotMeasureError(f"{', '.join(missing)} not installed; install drivecomm[bench], as make bench does")
    compiler = next((found for name in (os.environ.get("CC"), "cc", "gcc", "clang") if (found := _found(name))), None)
    if compiler is None:
        raise CannotMeasureError("no C compiler found; install gcc or clang, or name one in CC")
    paths = []
    for name in ("line_emulator", "reference_client"):
        command = [compiler, "-O2", "-std=c11", "-o", str(folder / name), str(_SOURCES / f"{name}.c")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise CannotMeasureError(f"{compiler} does not compile {name}.c: {done.stderr.strip()}")
        paths.append(folder / name)
    return Programs(*paths)


def _found(name: str | None) -> str | None:
    return shutil.which(name) if name else None
