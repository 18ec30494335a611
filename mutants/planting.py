"""Plant a mutant in a copy of its package, and let the conformance kit judge the copy."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mutant import HERE, package_folder

if TYPE_CHECKING:
    from mutant import Mutant

LONGEST_S = 900
"""A mutant may make the kit wait for something that never comes; that is a kill, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fate:
    """What became of a mutant. check: the first that did not hold, empty for a survivor. reason: in the kit's words."""

    mutant: Mutant
    check: str
    reason: str

    @property
    def survived(self) -> bool:
        """Whether the kit noticed nothing."""
        return not self.check


def judged(protocol: str, mutant: Mutant) -> Fate:
    """Plant a mutant and judge it. Raises ValueError when it cannot be planted or the package cannot be loaded."""
    folder = package_folder(protocol)
    with TemporaryDirectory(prefix="drivecomm-mutant-") as place:
        copy = Path(place).resolve() / folder.name
        shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("__pycache__"))
        file = copy / mutant.file
        file.write_text(mutant.planted_in(file.read_text(encoding="utf-8")), encoding="utf-8")
        command = [sys.executable, str(HERE / "trial.py"), str(copy.parent), protocol]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        except subprocess.TimeoutExpired:
            return Fate(mutant=mutant, check="the kit came to no end", reason=f"within {LONGEST_S} s")
    if done.returncode:
        last = done.stderr.strip().rpartition("\n")[2]
        raise ValueError(f"{mutant.id}: the package cannot be judged with it: {last}")
    return Fate(mutant=mutant, **json.loads(done.stdout.strip().rpartition("\n")[2]))
