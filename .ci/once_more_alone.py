"""pytest runner that repeats each failed test alone after all others are done.

    python .ci/once_more_alone.py ARGUMENT ...

A test that passes the second time is listed under "flaky" and does not fail the run. If many tests fail, that is no
coincidence, and none of them is repeated.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest.terminal import TerminalReporter

MOST = 30
PATIENCE_S = 900.0
"""Limit for a repeated test in seconds; longer than the time limit of any test."""


class OnceMoreAlone:
    """pytest plug-in of the process that controls the workers."""

    def __init__(self) -> None:
        self.flaky: dict[str, list[pytest.TestReport]] = {}

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Repeat the failed tests after the workers have ended."""
        if exitstatus != pytest.ExitCode.TESTS_FAILED:
            return
        reporter: TerminalReporter = session.config.pluginmanager.getplugin("terminalreporter")
        reports = [report for outcome in ("failed", "error") for report in reporter.stats.get(outcome, ())]
        failed = {report.nodeid: [each for each in reports if each.nodeid == report.nodeid] for report in reports}
        if len(failed) > MOST or not all(isinstance(report, pytest.TestReport) for report in reports):
            return
        self.flaky = {test: told for test, told in failed.items() if passes_alone(test, session.config.rootpath)}
        for outcome in ("failed", "error"):
            kept = [report for report in reporter.stats.pop(outcome, ()) if report.nodeid not in self.flaky]
            if kept:
                reporter.stats[outcome] = kept
        if self.flaky:
            reporter.stats["flaky"] = [told[0] for told in self.flaky.values()]
        if len(self.flaky) == len(failed):
            session.exitstatus = pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: TerminalReporter) -> None:
        """List the flaky tests, each with the reason of its first failure."""
        if not self.flaky:
            return
        terminalreporter.section("flaky")
        for test, told in self.flaky.items():
            terminalreporter.line(f"{test} failed, and passed when it ran again alone:")
            for report in told:
                terminalreporter.line(report.longreprtext)
        for test in self.flaky:
            terminalreporter.line(f"FLAKY {test}")


def passes_alone(test: str, folder: os.PathLike[str]) -> bool:
    """Return whether a test passes in a separate process; child processes of the test are ended as well."""
    process = subprocess.Popen(  # noqa: S603 - our own tests
        [sys.executable, "-m", "pytest", test],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(PATIENCE_S) == pytest.ExitCode.OK
    except subprocess.TimeoutExpired:
        return False
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


if __name__ == "__main__":
    # Same import path as for `python -m pytest`.
    sys.path[0] = str(Path.cwd())
    sys.exit(pytest.main(sys.argv[1:], plugins=[OnceMoreAlone()]))
