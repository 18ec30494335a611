"""What came of fuzzing a target."""

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
    from target import Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Flaw:
    """An input that shows something, and what. kept: where the input is now."""

    error: str
    place: str
    kept: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One target's run. slowest_s: the longest that one input took, None where nobody measured."""

    target: str
    inputs: int
    seconds: float
    flaws: tuple[Flaw, ...]
    grown_mib: float
    slowest_s: float | None = None

    @property
    def rate(self) -> float:
        """Inputs in a second."""
        return self.inputs / self.seconds if self.seconds else 0.0


def keep(target: Target, data: bytes) -> Path:
    """Keep an input that shows something; return where."""
    folder = FOUND / target.name
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / sha256(data).hexdigest()[:12]
    place.write_bytes(data)
    return place


def known_flaws(target: Target) -> dict[tuple[str, str], Flaw]:
    """Return what the kept inputs of a target still show, by kind of error and place."""
    known: dict[tuple[str, str], Flaw] = {}
    for data in target.found():
        try:
            target.check(data)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what we look for
            kind = kind_of(error)
            said = f"{kind[0]}: {str(error)[:200]}"
            known.setdefault(kind, Flaw(error=said, place=kind[1], kept=keep(target, data)))
    return known


def kind_of(error: BaseException) -> tuple[str, str]:
    """Return what tells two flaws apart: the kind of error and its place."""
    return type(error).__name__, place_of(error)


def place_of(error: BaseException) -> str:
    """Return where an error came from: two that come from the same place are the same flaw.

    That is the last line of drivecomm that was on the way to it, or of the target where a property broke.
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
    """Return the most memory that this process has had so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024 * 1024 if sys.platform == "darwin" else 1024)
