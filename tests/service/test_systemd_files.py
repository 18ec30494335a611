"""The files for systemd, checked by systemd's own tools if they are installed."""

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
"""Limit of the exposure level in tenths: systemd rates below 20 as OK, an unprotected service has 96 of 100."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="systemd is on Linux")
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


@pytest.fixture
def instance(tmp_path):
    """Return the unit of one plant, with the path of an existing program."""
    text = UNIT.read_text(encoding="utf-8")
    assert "/opt/drivecomm/bin/drivecomm" in text
    file = tmp_path / "drivecomm@hall2.service"
    file.write_text(text.replace("/opt/drivecomm/bin/drivecomm", sys.executable), encoding="utf-8")
    return file


def analysed(*arguments):
    done = subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout + done.stderr


@needs_systemd
def test_systemd_accepts_the_unit(instance):
    assert analysed("verify", "--man=no", str(instance)) == (0, "")


@needs_systemd
def test_systemd_rejects_an_unknown_key(instance):
    instance.write_text(instance.read_text().replace("WatchdogSec=", "WatchDogSecs="), encoding="utf-8")
    told = analysed("verify", "--man=no", str(instance))[1]
    assert "Unknown key" in told
    assert "WatchDogSecs" in told


@needs_systemd
def test_exposure_level_of_the_unit_is_low(instance):
    code, told = analysed("security", "--offline=true", f"--threshold={HIGHEST_EXPOSURE}", str(instance))
    assert code == 0, told
    exposure = re.search(r"Overall exposure level for \S+: ([\d.]+)", told)
    assert float(exposure[1]) * 10 < HIGHEST_EXPOSURE


def settings():
    """Return all settings of the unit in order, as pairs of name and value."""
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    return [tuple(line.split("=", 1)) for line in lines if line and line[0] not in "#["]


def test_unit_runs_an_existing_command():
    command = dict(settings())["ExecStart"].split()
    assert command[:2] == ["/opt/drivecomm/bin/drivecomm", "serve"]
    assert "serve" in COMMANDS


def test_unit_allows_only_serial_devices():
    assert dict(settings())["DevicePolicy"] == "closed"
    allowed = [value for name, value in settings() if name == "DeviceAllow"]
    assert allowed == ["char-ttyS rw", "char-ttyUSB rw", "char-ttyACM rw"]


def test_unit_forbids_gaining_privileges():
    known = dict(settings())
    assert known["NoNewPrivileges"] == "yes"
    assert known["CapabilityBoundingSet"] == known["AmbientCapabilities"] == ""
    assert known["User"] not in {"root", "0"}


def test_unit_has_a_watchdog_and_limited_restarts():
    known = dict(settings())
    assert known["Type"] == "notify"
    assert int(known["WatchdogSec"]) == 30
    assert known["Restart"] == "on-failure"
    assert int(known["StartLimitBurst"]) == 10


def test_stop_timeout_of_the_unit_allows_for_ramps():
    assert int(dict(settings())["TimeoutStopSec"]) >= 90


def test_every_setting_of_the_unit_has_a_comment():
    """A setting follows a comment, or belongs to a block that begins with one."""
    blocks = [block.splitlines() for block in re.split(r"\n\n+|^\[\w+\]\n", UNIT.read_text(), flags=re.MULTILINE)]
    plain = {"Description", "Documentation", "WantedBy"}
    for block in blocks:
        first = next((line for line in block if line), "")
        assert not first or first.startswith("#") or first.split("=")[0] in plain, first


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd-sysusers is not installed")
def test_sysusers_file_creates_the_user(tmp_path):
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


def test_udev_rules_are_assignments_and_matches():
    for line in (FOLDER / "70-drivecomm.rules").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            for part in line.split(", "):
                assert re.fullmatch(r'[A-Z]+(\{\w+\})?(==|\+=|=)"[^"]+"', part), part
