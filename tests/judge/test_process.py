import os
import sys
import time
from pathlib import Path

import pytest

from drivecomm.errors import UsageError
from drivecomm.judge.process import Process

pytestmark = [pytest.mark.soak, pytest.mark.skipif(os.name != "posix", reason="processes in groups")]

CHILD = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
LEAVES = (
    "import subprocess, sys, time; "
    f"subprocess.Popen([sys.executable, '-c', {CHILD!r}], start_new_session={{}}); time.sleep(60)"
)


def started(code):
    return Process([sys.executable, "-c", code], {}, time.monotonic)


def is_alive(number):
    status = Path(f"/proc/{number}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.parametrize("leaves_the_group", [False, True])
def test_ending_a_master_ends_its_child_processes(leaves_the_group):
    process = started(LEAVES.format(leaves_the_group))
    assert process.wait(20, lambda: bool(process.run.lines))
    child = int(process.run.lines[0].text)
    assert is_alive(child)
    process.end()
    deadline = time.monotonic() + 5
    while is_alive(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_alive(child)


def test_master_ignoring_sigterm_is_killed_after_its_limit():
    process = started("import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)")
    assert not process.wait(0.3)
    run = process.end(too_long=True)
    assert run.too_long
    assert run.code is None


def test_output_of_a_master_is_stored_up_to_a_limit():
    process = started("import sys\nfor number in range(100000): print(number)\nprint('bad', file=sys.stderr)")
    assert process.wait(60)
    run = process.end()
    assert run.code == 0
    assert len(run.lines) <= 2001


def test_missing_master_raises_usage_error_with_its_name():
    with pytest.raises(UsageError, match=r"the master './nowhere' cannot be started: No such file"):
        Process(["./nowhere"], {}, time.monotonic)
