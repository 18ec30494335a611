"""`.ci/run` repeats a failed test alone; exit code and last line show the result of the repetition."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUNNER = Path(__file__).parents[1] / ".ci" / "once_more_alone.py"

PASSES = "def test_passes(): pass\n"
FLAKY = """\
from pathlib import Path
def test_flaky():
    seen = Path(__file__).with_name("seen")
    again = seen.exists()
    seen.touch()
    assert again, "the first time"
"""
FLAKY_FIXTURE = """\
import pytest
from pathlib import Path
@pytest.fixture
def moody():
    seen = Path(__file__).with_name("seen by the fixture")
    again = seen.exists()
    seen.touch()
    assert again, "the first time"
def test_set_up_badly(moody): pass
"""
CRASHES = """\
import os
from pathlib import Path
def test_crashes():
    seen = Path(__file__).with_name("seen before the crash")
    if not seen.exists():
        seen.touch()
        os._exit(1)
"""
FAILS = "def test_fails(): assert False\n"
UNLOADABLE = "import what_there_is_not\n"

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(sys.platform != "linux", reason="the test needs process groups"),
]


def run(folder, *arguments, **files):
    """Run tests with the runner; return its exit code and its output lines."""
    # Strict like the project's configuration: an unknown setting is an error.
    (folder / "pytest.ini").write_text("[pytest]\naddopts = -q --strict-config\ncache_dir = .cache/pytest\n")
    for name, text in files.items():
        (folder / f"test_{name}.py").write_text(text)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    done = subprocess.run(
        [sys.executable, str(RUNNER), *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout.splitlines()


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["one process", "workers"])
def test_flaky_test_is_listed_and_does_not_fail_the_run(tmp_path, workers):
    code, lines = run(tmp_path, *workers, passes=PASSES, flaky=FLAKY, fixture=FLAKY_FIXTURE)
    assert code == 0
    assert lines[-1].startswith("1 passed, 2 flaky in ")
    heading = next(place for place, line in enumerate(lines) if " flaky " in line and line.startswith("==="))
    assert "FLAKY test_flaky.py::test_flaky" in lines[heading:]
    assert "FLAKY test_fixture.py::test_set_up_badly" in lines[heading:]
    assert any("the first time" in line for line in lines[heading:])
    assert not any(line.startswith("FAILED") for line in lines)


def test_runner_repeats_a_test_whose_worker_crashed(tmp_path):
    code, lines = run(tmp_path, "-n", "1", passes=PASSES, crashes=CRASHES)
    assert (code, lines[-1].partition(" in ")[0]) == (0, "1 passed, 1 flaky")


def test_test_that_fails_twice_fails_the_run(tmp_path):
    code, lines = run(tmp_path, passes=PASSES, flaky=FLAKY, fails=FAILS)
    assert (code, lines[-1].partition(" in ")[0]) == (1, "1 failed, 1 passed, 1 flaky")
    assert any(line.startswith("FAILED test_fails.py::test_fails") for line in lines)


def test_runner_repeats_nothing_if_many_tests_fail(tmp_path):
    many = "".join(f"def test_{number}(): assert False\n" for number in range(31))
    code, lines = run(tmp_path, flaky=FLAKY, many=many)
    assert (code, lines[-1].partition(" in ")[0]) == (1, "32 failed")


def test_file_that_cannot_be_imported_fails_the_run(tmp_path):
    code, lines = run(tmp_path, passes=PASSES, unloadable=UNLOADABLE)
    assert code == 2
    assert lines[-1].startswith("1 error in ")
