"""Run tests on the framework that stands in a folder; run by `planting.py` in a process of its own, in that folder.

    python -P mutants/trial_by_tests.py FOLDER TEST ...

Prints one JSON object: `check` and `reason` of the first test that fails, both empty when none does.
"""

from __future__ import annotations

import json
import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


class FirstFailure:
    """What pytest tells of the first test that fails, and what cannot be loaded."""

    def __init__(self) -> None:
        self.check = self.reason = self.unloadable = ""

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Take note of a file that cannot be loaded."""
        if report.failed:
            self.unloadable = report.longreprtext.strip().rpartition("\n")[2]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Take note of a test that fails."""
        if report.failed and not self.check:
            self.check = f"{report.location[0]}::{report.nodeid.partition('::')[2]}"
            self.reason = report.longreprtext.strip().rpartition("\n")[2]


def main(folder: str, *tests: str) -> int:
    """Run them; return the exit code, 0 when they could be run."""
    spec = find_spec("drivecomm")
    if spec is None or Path(str(spec.origin)).parent.parent != Path(folder):
        raise SystemExit(f"{spec and spec.origin} would be judged and not what stands in {folder}")
    first = FirstFailure()
    place = ["-o", f"cache_dir={folder}/.cache", f"--config-file={ROOT / 'pyproject.toml'}", f"--rootdir={ROOT}"]
    code = pytest.main(["-x", *place, *(str(ROOT / test) for test in tests)], plugins=[first])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        print(first.unloadable or f"pytest ended with {code!r}", file=sys.stderr)
        return 1
    print(json.dumps({"check": first.check, "reason": first.reason}))
    return 0


if __name__ == "__main__":
    ended = main(*sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # A thread that a mistake keeps alive does not keep its judge waiting.
    os._exit(ended)
