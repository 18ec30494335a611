"""A test that hangs in a child process ends at its time limit, together with the child."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HANGS = """\
import pytest, subprocess, sys
from pathlib import Path

SLEEPS = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); time.sleep(600)"

@pytest.mark.timeout(1)
def test_hangs():
    # The child starts a grandchild; the interrupted test still waits for the child in `finally`.
    starts = "import subprocess as s, sys; p = s.Popen([sys.executable, '-c', %r]); print(p.pid, flush=True); p.wait()"
    starts %= SLEEPS
    child = subprocess.Popen([sys.executable, "-c", starts], stdout=subprocess.PIPE, text=True)
    Path("children").write_text(f"{child.pid} {child.stdout.readline()}")
    try:
        child.wait()
    finally:
        child.terminate()
        child.wait()
        child.stdout.close()

def test_goes_on():
    pass
"""

pytestmark = [pytest.mark.soak, pytest.mark.skipif(sys.platform != "linux", reason="the test reads /proc")]


@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["one process", "a worker"])
def test_children_of_a_test_end_at_its_time_limit(tmp_path, workers):
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["time_limits"]\n')
    (tmp_path / "test_hanging.py").write_text(HANGS)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-c", os.devnull, "--rootdir", ".", "-p", "no:cacheprovider", *workers],
        env={**environment, "PYTHONPATH": str(Path(__file__).parent)},
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stdout
    assert "1 failed, 1 passed" in done.stdout
    assert "Timeout" in done.stdout
    for number in (tmp_path / "children").read_text().split():
        assert is_gone(number), done.stdout


def is_gone(number):
    stat = Path("/proc", number, "stat")
    # A child whose parent was killed stays a zombie if no process collects it.
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"
