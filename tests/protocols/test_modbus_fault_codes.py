"""Drives that do not report the code of a fault; the fault itself must still be reported."""

import pytest

import drivecomm
from drivecomm.errors import StateError
from drivecomm.models import load_model, model_names
from drivecomm.profiles import RegisterRefusal
from drivecomm.protocol import DriveState
from drivecomm.virtual import VirtualLine, virtual_drive

CONTROLS = {
    name: load_model("drivecomm_modbus", "modbus", name).control for name in model_names("drivecomm_modbus", "modbus")
}
TOLD = [
    name for name, each in CONTROLS.items() if "fault_code" in each and "fault" in each["status"] and "reset" in each
]


@pytest.mark.parametrize("name", TOLD)
def test_fault_with_a_refused_code_is_reported_without_one(name):
    drive = virtual_drive("modbus", 1, model=name)
    line, code = VirtualLine([drive]), CONTROLS[name]["fault_code"]
    in_status = {given[0].partition(".")[0] for given in CONTROLS[name]["status"].values()}
    if code.partition(".")[0] in in_status:
        pytest.skip("it is part of the status")
    held = int(drive._machine._targets[code].place.start)
    answer = drive.answer

    def without_code(message, now):
        if message.function in (3, 4, 0x64) and message.start <= held < message.start + (message.count or 1):
            raise RegisterRefusal("unknown")
        return answer(message, now)

    drive.answer = without_code
    drive.trip(7, line.time)
    line.advance(15)
    with drivecomm.open_bus(line.port) as bus:
        one = bus.drive("modbus", 1, model=name, confirmed=name)
        status = one.status()
        assert (status.state, status.fault, status.fault_code) == (DriveState.FAULT, True, None)
        with pytest.raises(StateError, match="the drive has a fault and cannot start"):
            one.start()
        one.reset()
        assert not one.status().fault


def test_invt_fault_is_reported_by_its_code_if_the_status_lacks_it():
    drive = virtual_drive("modbus", 1, model="invt")
    line = VirtualLine([drive])
    drive.trip(7, line.time)
    live = drive._machine.live

    def without_4(now):
        live(now)
        drive._machine.words[str(0x2100)] = 3

    drive._machine.live = without_4
    with drivecomm.open_bus(line.port) as bus:
        status = bus.drive("modbus", 1, model="invt").status()
    assert (status.fault, status.fault_code) == (True, 7)


@pytest.mark.parametrize("name", ["optidrive-plus", "optidrive-e3"])
def test_fault_code_that_shares_a_register_with_the_status_is_shown(name):
    drive = virtual_drive("modbus", 1, model=name)
    line = VirtualLine([drive])
    drive.trip(7, line.time)
    with drivecomm.open_bus(line.port) as bus:
        status = bus.drive("modbus", 1, model=name).status()
    assert (status.fault, status.fault_code) == (True, 7)
