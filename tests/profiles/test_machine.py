"""A virtual drive that is a profile: what time, mains and trips make of it."""

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


def test_a_trip_is_a_fault_at_once(drive):
    drive.machine.trip(9, drive.now)
    assert drive.machine.state.means is DriveState.FAULT
    assert not drive.motor.running


def test_a_motor_that_trips_by_itself_is_a_fault(drive):
    drive.motor.trip(9, drive.now)
    drive.passes(0.1)
    assert drive.machine.state.name == "fault"


def test_a_control_word_finds_the_drive_as_it_is_by_then(drive):
    drive.machine.control(0x0002, drive.now)
    assert drive.machine.state.name == "quick stop active"
    drive.now += 60
    drive.machine.control(0x0006, drive.now)
    assert drive.machine.state.name == "ready to switch on"


def test_mains_forget_the_control_word(drive):
    drive.machine.trip(9, drive.now)
    drive.machine.control(0x0080, drive.now)
    assert not drive.motor.fault
    drive.machine.power_up(drive.now)
    assert drive.machine.word == 0
    drive.machine.trip(9, drive.now)
    drive.machine.control(0x0080, drive.now)
    assert not drive.motor.fault


def test_a_state_that_something_else_brings_about_moves_the_motor(drive):
    drive.machine.enter("switched on", drive.now)
    drive.passes(5)
    assert not drive.motor.running
