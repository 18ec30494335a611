"""A virtual Mitsubishi drive under `mitsub_vfd` of LinuxCNC, which has run an A500, an E500 and an E700.

The program never checks the sum of a reply, takes the value from a fixed place, and ignores refusals.
"""

import sys

import pytest
from linuxcnc import LINUXCNC, driver, marks, served

from drivecomm.virtual import virtual_drive

pytestmark = marks

PROGRAM = LINUXCNC / "usr/bin/mitsub_vfd"


@pytest.mark.parametrize("model", ["fr500", "fr700"])
def test_mitsub_vfd_runs_a_drive_in_both_directions_and_shows_its_values(tmp_path, model):
    drive = virtual_drive("mitsubishi", 1, model=model)
    with (
        served(drive, tmp_path) as (line, _),
        driver(tmp_path, "spindle", f"{sys.executable} {PROGRAM} --baud 19200 --port {line} spindle=01") as spindle,
    ):
        spindle.set(monitor=1, estop=1, motor_cmd=25, run=1)
        spindle.wait_for(lambda: spindle.get("motor-fb") == 25 and spindle.get("up-to-speed"))
        assert drive.motor.target_hz == drive.motor.output_hz == 25.0
        spindle.wait_for(lambda: spindle.get("motor-amps") > 0)
        assert [spindle.get(f"stat-bit-{bit}") for bit in (0, 1, 2, 7)] == [True, True, False, False]
        spindle.set(fwd=0)
        spindle.wait_for(lambda: drive.motor.output_hz == -25)
        spindle.wait_for(lambda: spindle.get("stat-bit-2") and not spindle.get("stat-bit-1"))
        spindle.set(motor_cmd=10)
        spindle.wait_for(lambda: spindle.get("motor-fb") == 10)
        spindle.set(run=0)
        spindle.wait_for(lambda: spindle.get("motor-fb") == 0)
        assert not drive.motor.running


def test_mitsub_vfd_shows_a_trip_and_stops_on_estop(tmp_path):
    drive = virtual_drive("mitsubishi", 1, model="fr500")
    with (
        served(drive, tmp_path) as (line, trip),
        driver(tmp_path, "spindle", f"{sys.executable} {PROGRAM} --baud 19200 --port {line} spindle=01") as spindle,
    ):
        spindle.set(monitor=1, estop=1, motor_cmd=25, run=1)
        spindle.wait_for(lambda: spindle.get("motor-fb") == 25)
        spindle.set(estop=0)
        spindle.wait_for(lambda: not drive.motor.running)
        trip(0x10)
        spindle.wait_for(lambda: spindle.get("alarm"))
        assert drive.peek("H74.low", 0) == 0x10
