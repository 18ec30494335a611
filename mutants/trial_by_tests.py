"""Trial of a mutated framework by tests; `planting.py` runs it in a separate process, in the framework's folder.

    python -P mutants/trial_by_tests.py FOLDER TEST ...

Prints one JSON object: `check` and `reason` of the first test that fails, both empty if none does.
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
    """pytest plug-in that records the first failed test, and any file that cannot be loaded."""

    def __init__(self) -> None:
        self.check = self.reason = self.unloadable = ""

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Record a file that cannot be loaded."""
        if report.failed:
            self.unloadable = report.longreprtext.strip().rpartition("\n")[2]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record the first failed test."""
        if report.failed and not self.check:
            self.check = f"{report.location[0]}::{report.nodeid.partition('::')[2]}"
            self.reason = report.longreprtext.strip().rpartition("\n")[2]


def main(folder: str, *tests: str) -> int:
    """Run the tests and print the first failure; return the exit code, 0 if they could be run."""
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
    # Exit without waiting for threads that the mistake keeps alive.
    os._exit(ended)
