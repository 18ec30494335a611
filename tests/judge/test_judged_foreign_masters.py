"""Third-party masters, and a master in C, judged as programs from the command line."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.soak, pytest.mark.foreign, pytest.mark.timeout(240)]

MASTERS = Path(__file__).parent / "masters"
LINUXCNC = Path(os.environ.get("DRIVECOMM_LINUXCNC", "/nowhere"))
GS2 = ("--drive", "modbus:1,model=gs2")


def judged(folder, *words):
    """Run the judge command; return its exit code, and outcome and reason by case."""
    report = folder / "report.json"
    command = [sys.executable, "-m", "drivecomm", "judge", "--json", report, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=230)
    assert report.exists(), done.stderr
    verdicts = json.loads(report.read_text())["verdicts"]
    return done.returncode, {each["case"]: (each["outcome"], each["reason"]) for each in verdicts}


def failed(found):
    return {name for name, (outcome, _) in found.items() if outcome == "failed"}


@pytest.mark.skipif(shutil.which("mbpoll") is None, reason="mbpoll is not installed")
def test_mbpoll_fails_the_cases_that_require_a_retry(tmp_path):
    tasks = {
        "read": "-t 4 -r 2330 {port}",
        "write": "-t 4 -r 2330 {port} {value}",
        "start": "-t 4 -r 2331 {port} 1",
        "stop": "-t 4 -r 2331 {port} 0",
    }
    told = [word for name, words in tasks.items() for word in ("--task", f"{name}={words}")]
    mbpoll = ("mbpoll", "-m", "rtu", "-a", "1", "-b", "9600", "-P", "none", "-0", "-1", "-o", "1", "{task}")
    code, found = judged(tmp_path, *GS2, *told, "--", *mbpoll)
    assert code == 1
    assert failed(found) == {"read-lost-once", "stop-lost", "stop-unheard", "stop-mute"}
    assert found["read-refused-2"][0] == found["start-lost"][0] == found["write-ends"][0] == "passed"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_correct_master_in_c_passes_all_cases(tmp_path):
    program = tmp_path / "modbus_master"
    subprocess.run(["cc", "-O1", "-o", program, MASTERS / "modbus_master.c"], check=True, timeout=60)
    tasks = ("--task", "read=read 2330", "--task", "write=write 2330 250")
    code, found = judged(tmp_path, *GS2, *tasks, "--", str(program), "{port}")
    assert failed(found) == set()
    assert code == 0
    assert found["read-lost-once"][0] == found["write-ends"][0] == "passed"


@pytest.mark.skipif(not (LINUXCNC / "usr/bin/gs2_vfd").exists(), reason="DRIVECOMM_LINUXCNC names no linuxcnc-uspace")
def test_linuxcnc_is_judged_as_a_continuous_master(tmp_path):
    cases = ("run-plain", "run-off-on", "run-damaged", "run-stored")
    named = [word for name in cases for word in ("--case", name)]
    master = (sys.executable, str(MASTERS / "linuxcnc_master.py"), "{port}")
    code, found = judged(tmp_path, *GS2, "--jobs", "1", "--limit", "25", *named, "--", *master)
    assert found["run-plain"][0] == "passed"
    assert set(found) == set(cases)
    assert code in (0, 1)
