"""The state machine of a virtual drive: effects of time, power loss and trips."""

import pytest
from played import Drive

from drivecomm.profiles import control_profile
from drivecomm.protocol import DriveState

DRIVECOM = control_profile("drivecom")


@pytest.fixture
def drive():
    found = Drive(DRIVECOM)
    for word in (0x0006, 0x0007, 0x000F):
        found.machine.control(word, 0.0)
    found.passes(5)
    return found


def test_trip_is_a_fault_immediately(drive):
    drive.machine.trip(9, drive.now)
    assert drive.machine.state.means is DriveState.FAULT
    assert not drive.motor.running


def test_trip_of_the_motor_puts_the_machine_into_fault(drive):
    drive.motor.trip(9, drive.now)
    drive.passes(0.1)
    assert drive.machine.state.name == "fault"


def test_control_word_acts_on_the_state_at_its_time(drive):
    drive.machine.control(0x0002, drive.now)
    assert drive.machine.state.name == "quick stop active"
    drive.now += 60
    drive.machine.control(0x0006, drive.now)
    assert drive.machine.state.name == "ready to switch on"


def test_power_up_clears_the_control_word(drive):
    drive.machine.trip(9, drive.now)
    drive.machine.control(0x0080, drive.now)
    assert not drive.motor.fault
    drive.machine.power_up(drive.now)
    assert drive.machine.word == 0
    drive.machine.trip(9, drive.now)
    drive.machine.control(0x0080, drive.now)
    assert not drive.motor.fault


def test_state_entered_without_a_control_word_acts_on_the_motor(drive):
    drive.machine.enter("switched on", drive.now)
    drive.passes(5)
    assert not drive.motor.running
