"""Conformance of monitoring-only models: every command must be refused before anything is sent."""

import pytest

from drivecomm.protocol import installed
from drivecomm.testing import FULL, all_checks, try_out
from drivecomm_modbus.exchanges import ModbusOperations

METER = """
format = 1
protocol = "modbus"
name = "meter"
title = "Drives that are only watched"
source = "meter manual p. 1"
[quantities]
output_frequency = "2"
[control]
fault_code = "3"
[control.status]
running = ["1", 0x0001, 0x0001]
fault = ["1", 0x0002, 0x0002]
[[parameter]]
address = "2"
name = "actual_frequency"
unit = "Hz"
factor = "0.1"
access = "r"
start = "0"
[[parameter]]
address = "3"
name = "fault"
access = "r"
start = "0"
"""


@pytest.fixture
def checks(tmp_path, monkeypatch):
    folder = tmp_path / "modbus"
    folder.mkdir()
    (folder / "meter.toml").write_text(METER.lstrip(), encoding="utf-8")
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
    return [each for each in all_checks(installed["modbus"], FULL) if "/models/meter/" in each.name]


def test_monitoring_only_model_passes_without_motion_checks(checks):
    kinds = {check.kind for check in checks}
    assert "refuses every command" in kinds
    assert "runs at the reference" not in kinds
    assert [each for each in map(try_out, checks) if not each.passed] == []


def test_command_accepted_by_a_monitoring_only_drive_is_found(checks, monkeypatch):
    def reset(self):
        yield from self.probe()

    monkeypatch.setattr(ModbusOperations, "reset", reset)
    (verdict,) = [try_out(check) for check in checks if check.kind == "refuses every command"]
    assert not verdict.passed
    assert "a reset is not refused" in verdict.reason
