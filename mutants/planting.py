"""Plant a mutant in a copy of its package, and let the conformance kit or the tests judge the copy."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mutant import HERE, framework_folder, package_folder

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mutant import Mutant

KIT_S = 900
TESTS_S = 120
"""A mutant may make its judges wait for something that never comes; that is a kill, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fate:
    """What became of a mutant. check: the first that did not hold, empty for a survivor. reason: in the judge's words.

    A check of the kit has a name, a test its id.
    """

    mutant: Mutant
    check: str
    reason: str

    @property
    def survived(self) -> bool:
        """Whether nothing was noticed."""
        return not self.check


def judged(protocol: str, mutant: Mutant) -> Fate:
    """Plant a mutant and let the kit judge it.

    Raises ValueError when it cannot be planted or the package cannot be loaded.
    """
    with _copy_of(package_folder(protocol), mutant) as copy:
        return _tried(mutant, [HERE / "trial.py", copy.parent, protocol], copy.parent, KIT_S)


def judged_by_tests(mutant: Mutant) -> Fate:
    """Plant a mutant in the framework and let its tests judge it.

    Raises ValueError when it cannot be planted, the tests cannot be loaded with it, or the one that noticed it fails
    without it, too.
    """
    fate = _tested(mutant, mutant.tests, planted=mutant)
    if "::" in fate.check and not _tested(mutant, [fate.check]).survived:
        raise ValueError(f"{mutant.id}: {fate.check} fails without it, too: {fate.reason}")
    return fate


def _tested(mutant: Mutant, tests: Sequence[str], planted: Mutant | None = None) -> Fate:
    with _copy_of(framework_folder(), planted) as copy:
        return _tried(mutant, [HERE / "trial_by_tests.py", copy.parent, *tests], copy.parent, TESTS_S)


@contextmanager
def _copy_of(folder: Path, mutant: Mutant | None) -> Iterator[Path]:
    """Copy a package with this mistake in it, or none."""
    with TemporaryDirectory(prefix="drivecomm-mutant-", ignore_cleanup_errors=True) as place:
        copy = Path(place).resolve() / folder.name
        # What is compiled already is good for all files but one.
        shutil.copytree(folder, copy)
        if mutant is not None:
            file = copy / mutant.file
            file.write_text(mutant.planted_in(file.read_text(encoding="utf-8")), encoding="utf-8")
            for compiled in file.parent.glob(f"__pycache__/{file.stem}.*"):
                compiled.unlink()
        yield copy


def _tried(mutant: Mutant, script: list[object], place: Path, seconds: float) -> Fate:
    """Run a trial in the folder that holds the copy, which all its programs find before anything that is installed."""
    command = [sys.executable, "-P", *map(str, script)]
    # Whatever the tests have started ends with them.
    with subprocess.Popen(
        command,
        cwd=place,
        env={**os.environ, "PYTHONPATH": str(place)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            out, errors = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return Fate(mutant=mutant, check="its judges came to no end", reason=f"within {seconds} s")
    if process.returncode:
        last = errors.strip().rpartition("\n")[2]
        raise ValueError(f"{mutant.id}: the package cannot be judged with it: {last}")
    return Fate(mutant=mutant, **json.loads(out.strip().rpartition("\n")[2]))
