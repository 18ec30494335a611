"""Planting of a mutant in a copy of its package, and its trial by the conformance kit or the tests."""

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
"""Time limit in seconds: a mutant may make its tests wait forever, which counts as killed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fate:
    """Result of a mutant's trial.

    check: the first check or test that failed, empty for a survivor; a check has a name, a test an id. reason: its
    message.
    """

    mutant: Mutant
    check: str
    reason: str

    @property
    def survived(self) -> bool:
        """Whether no check or test failed."""
        return not self.check


def judged(protocol: str, mutant: Mutant) -> Fate:
    """Plant a mutant and judge it by the conformance kit.

    Raises ValueError if it cannot be planted or the package cannot be loaded.
    """
    with _copy_of(package_folder(protocol), mutant) as copy:
        return _tried(mutant, [HERE / "trial.py", copy.parent, protocol], copy.parent, KIT_S)


def judged_by_tests(mutant: Mutant) -> Fate:
    """Plant a mutant in the framework and judge it by its tests.

    Raises ValueError if it cannot be planted, if the tests cannot be loaded with it, or if the failed test also fails
    without it.
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
    """Yield a copy of a package with this mistake planted, or an unchanged copy."""
    with TemporaryDirectory(prefix="drivecomm-mutant-", ignore_cleanup_errors=True) as place:
        copy = Path(place).resolve() / folder.name
        # The copy includes compiled files; only that of the mutated file is removed below.
        shutil.copytree(folder, copy)
        if mutant is not None:
            file = copy / mutant.file
            file.write_text(mutant.planted_in(file.read_text(encoding="utf-8")), encoding="utf-8")
            for compiled in file.parent.glob(f"__pycache__/{file.stem}.*"):
                compiled.unlink()
        yield copy


def _tried(mutant: Mutant, script: list[object], place: Path, seconds: float) -> Fate:
    """Run a trial script in the copy's folder, which comes before all installed packages in its processes."""
    command = [sys.executable, "-P", *map(str, script)]
    # Processes started by the tests belong to the same session, so they can be killed as well.
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
