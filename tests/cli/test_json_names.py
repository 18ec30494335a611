"""JSON objects about a drive: every command gives the name of the drive under the key `drive_name`."""

from pathlib import Path

import pytest

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "line"
[[drive]]
name = "pump"
drive = "vabus:1"
armed = true
options = { model = "agile" }
"""

COMMANDS = {
    "read": ["read", "pump", "480"],
    "read in vain": ["read", "pump", "nonsense"],
    "write": ["write", "pump", "480", "10"],
    "status": ["status"],
    "status of one": ["status", "pump"],
    "start": ["start", "pump", "--link-loss", "hold"],
    "stop": ["stop", "pump"],
    "stop all": ["stop", "--all"],
    "reference": ["reference", "pump", "10Hz"],
    "reset": ["reset", "pump"],
    "poll": ["poll", "pump", "480", "--cycles", "1"],
    "stats": ["stats", "pump", "--for", "0.2"],
    "backup": ["backup", "pump", "pump.toml"],
    "baseline accept": ["baseline", "accept", "pump"],
    "forecast": ["forecast", "pump", "480"],
    "doctor": ["doctor", "--quick", "--protocol", "vabus", "-a", "1"],
}


def objects_of_drives(content):
    """Yield all objects that name a drive, however deeply they are nested."""
    if isinstance(content, dict):
        if "drive" in content:
            yield content
        content = list(content.values())
    if isinstance(content, list):
        for each in content:
            yield from objects_of_drives(each)


@pytest.mark.parametrize("command", COMMANDS)
def test_json_objects_hold_the_name_of_the_drive(shell, tmp_path, monkeypatch, command):
    shell.line(virtual_drive("vabus", 1))
    monkeypatch.chdir(tmp_path)
    Path("plant.toml").write_text(PLANT, encoding="utf-8")
    shell(*COMMANDS[command], "--json", port=None)
    found = list(objects_of_drives(shell.objects))
    assert found
    assert {each["drive_name"] for each in found} <= {"pump", "vabus:*", "vabus:1"}
    assert "pump" in {each["drive_name"] for each in found}


@pytest.mark.parametrize("command", [["scan", "--protocol", "vabus", "-a", "1"], ["read", "vabus:1", "480"]])
def test_drive_name_is_the_address_without_a_plant(shell, command):
    shell.line(virtual_drive("vabus", 1))
    assert shell(*command, "--json") == 0
    assert {each["drive_name"] for each in shell.objects} == {"vabus:1"}
