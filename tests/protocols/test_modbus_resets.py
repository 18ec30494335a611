"""Resets after a trip while running: the start that the drive still holds is cleared before the fault."""

import pytest

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

RUN = {"siemens-v20": "40006", "gs2": "0x091B", "hitachi-wj200": "c0x01"}


@pytest.mark.parametrize("name", RUN)
def test_reset_of_a_trip_clears_the_start_first(name):
    drive = virtual_drive("modbus", 1, model=name)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        one = bus.drive("modbus", 1, model=name)
        one.set_reference(**({"hz": 20} if one.capabilities.reference_hz else {"percent": 40}))
        one.start()
        drive.trip(3, line.time)
        asked = []
        motor, reset = drive.motor, type(drive.motor).reset

        def seen(_motor, now):
            asked.append(drive._machine.words[drive._machine._targets[RUN[name]].place.name])
            reset(motor, now)

        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(type(motor), "reset", seen)
            one.reset()
        assert asked == [0]
        assert not one.status().fault
        assert not motor.running
        one.start()
        assert motor.running
