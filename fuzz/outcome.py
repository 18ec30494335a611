"""Outcome of fuzzing a target, and storage of the inputs that revealed a flaw."""

from __future__ import annotations

import resource
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from traceback import walk_tb
from typing import TYPE_CHECKING

from target import FOUND, PropertyBrokenError

if TYPE_CHECKING:
    from target import FuzzTarget


@dataclass(frozen=True, slots=True, kw_only=True)
class Flaw:
    """A flaw that an input revealed. kept: the file with the input."""

    error: str
    place: str
    kept: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class FuzzResult:
    """Result of fuzzing one target. slowest_s: the longest duration of one input, None if not measured."""

    target: str
    inputs: int
    seconds: float
    flaws: tuple[Flaw, ...]
    grown_mib: float
    slowest_s: float | None = None

    @property
    def rate(self) -> float:
        """Inputs per second."""
        return self.inputs / self.seconds if self.seconds else 0.0


def store_input(target: FuzzTarget, data: bytes) -> Path:
    """Store an input that revealed a flaw; return its path."""
    folder = FOUND / target.name
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / sha256(data).hexdigest()[:12]
    place.write_bytes(data)
    return place


def known_flaws(target: FuzzTarget) -> dict[tuple[str, str], Flaw]:
    """Return the flaws that the stored inputs of a target still reveal, by kind of error and place."""
    known: dict[tuple[str, str], Flaw] = {}
    for data in target.found():
        try:
            target.check(data)
        except Exception as error:  # noqa: BLE001 - any exception is a finding
            kind = kind_of(error)
            said = f"{kind[0]}: {str(error)[:200]}"
            known.setdefault(kind, Flaw(error=said, place=kind[1], kept=store_input(target, data)))
    return known


def kind_of(error: BaseException) -> tuple[str, str]:
    """Return the key that identifies a flaw: the kind of error and its place."""
    return type(error).__name__, place_of(error)


def place_of(error: BaseException) -> str:
    """Return the place of an error in the code; errors with the same place count as the same flaw.

    The place is the last line of drivecomm in the traceback, or the target's line if a property broke.
    """
    frames = list(walk_tb(error.__traceback__))
    owner = "drivecomm" if not isinstance(error, PropertyBrokenError) else ""
    places = [
        f"{Path(frame.f_code.co_filename).name}:{line}"
        for frame, line in frames
        if str(frame.f_globals.get("__name__")).startswith(owner) and frame.f_code.co_name != "expect"
    ]
    return places[-1] if places else ""


def peak_mib() -> float:
    """Return the peak memory of this process in MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024 * 1024 if sys.platform == "darwin" else 1024)
