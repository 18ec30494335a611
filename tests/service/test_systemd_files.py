"""The files for systemd: read by systemd's own tools, as far as they are on this machine."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivecomm.cli.app import COMMANDS

FOLDER = Path(__file__).resolve().parents[2] / "packaging" / "systemd"
UNIT = FOLDER / "drivecomm@.service"
HIGHEST_EXPOSURE = 20
"""In tenths, of 100: systemd calls less than 20 OK, and an unprotected service has 96."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="systemd is on Linux")
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


@pytest.fixture
def instance(tmp_path):
    """The unit of one plant, with a program that is there."""
    text = UNIT.read_text(encoding="utf-8")
    assert "/opt/drivecomm/bin/drivecomm" in text
    file = tmp_path / "drivecomm@hall2.service"
    file.write_text(text.replace("/opt/drivecomm/bin/drivecomm", sys.executable), encoding="utf-8")
    return file


def analysed(*arguments):
    done = subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout + done.stderr


@needs_systemd
def test_systemd_finds_nothing_wrong(instance):
    assert analysed("verify", "--man=no", str(instance)) == (0, "")


@needs_systemd
def test_systemd_would_find_a_wrong_line(instance):
    instance.write_text(instance.read_text().replace("WatchdogSec=", "WatchDogSecs="), encoding="utf-8")
    told = analysed("verify", "--man=no", str(instance))[1]
    assert "Unknown key" in told
    assert "WatchDogSecs" in told


@needs_systemd
def test_the_exposure_is_low(instance):
    code, told = analysed("security", "--offline=true", f"--threshold={HIGHEST_EXPOSURE}", str(instance))
    assert code == 0, told
    exposure = re.search(r"Overall exposure level for \S+: ([\d.]+)", told)
    assert float(exposure[1]) * 10 < HIGHEST_EXPOSURE


def settings():
    """All settings of the unit in their order, as pairs."""
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    return [tuple(line.split("=", 1)) for line in lines if line and line[0] not in "#["]


def test_it_runs_a_command_that_there_is():
    command = dict(settings())["ExecStart"].split()
    assert command[:2] == ["/opt/drivecomm/bin/drivecomm", "serve"]
    assert "serve" in COMMANDS


def test_only_serial_devices_are_allowed():
    assert dict(settings())["DevicePolicy"] == "closed"
    allowed = [value for name, value in settings() if name == "DeviceAllow"]
    assert allowed == ["char-ttyS rw", "char-ttyUSB rw", "char-ttyACM rw"]


def test_no_right_can_be_gained():
    known = dict(settings())
    assert known["NoNewPrivileges"] == "yes"
    assert known["CapabilityBoundingSet"] == known["AmbientCapabilities"] == ""
    assert known["User"] not in {"root", "0"}


def test_the_watchdog_is_watched_and_a_failed_server_comes_back_within_limits():
    known = dict(settings())
    assert known["Type"] == "notify"
    assert int(known["WatchdogSec"]) == 30
    assert known["Restart"] == "on-failure"
    assert int(known["StartLimitBurst"]) == 10


def test_the_end_has_time_for_ramps():
    assert int(dict(settings())["TimeoutStopSec"]) >= 90


def test_every_choice_is_explained():
    """A setting stands under a comment, or in a block that begins with one."""
    blocks = [block.splitlines() for block in re.split(r"\n\n+|^\[\w+\]\n", UNIT.read_text(), flags=re.MULTILINE)]
    plain = {"Description", "Documentation", "WantedBy"}
    for block in blocks:
        first = next((line for line in block if line), "")
        assert not first or first.startswith("#") or first.split("=")[0] in plain, first


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd-sysusers is not installed")
def test_the_user_can_be_made(tmp_path):
    file = FOLDER / "drivecomm.sysusers"
    (tmp_path / "etc").mkdir()
    done = subprocess.run(
        ["systemd-sysusers", f"--root={tmp_path}", "--dry-run", "-"],
        input=file.read_text(encoding="utf-8"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "drivecomm" in done.stdout + done.stderr


def test_the_udev_rules_are_assignments_and_matches():
    for line in (FOLDER / "70-drivecomm.rules").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            for part in line.split(", "):
                assert re.fullmatch(r'[A-Z]+(\{\w+\})?(==|\+=|=)"[^"]+"', part), part
