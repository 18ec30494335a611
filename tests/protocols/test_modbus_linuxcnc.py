"""Virtual Modbus and Huanyang drives under spindle drivers of LinuxCNC, written by owners of such drives."""

import time

import pytest
from linuxcnc import driver, marks, served

from drivecomm.virtual import virtual_drive

pytestmark = marks

INI = """
[{section}]
TYPE=rtu
DEVICE={line}
TARGET=1
BAUD=9600
BITS=8
PARITY=none
STOPBITS=1
MOTOR_HZ=50
MOTOR_RPM=1500
"""


def ini(folder, line, section):
    path = folder / "drive.ini"
    path.write_text(INI.format(line=line, section=section))
    return path


def test_gs2_vfd_runs_a_gs2_and_shows_its_values(tmp_path):
    drive = virtual_drive("modbus", 1, model="gs2")
    with (
        served(drive, tmp_path) as (line, _),
        driver(tmp_path, "gs2_vfd", f"gs2_vfd -d {line} -r 9600 -p none -s 1") as spindle,
    ):
        spindle.set(speed_command=1380, spindle_fwd=1)

        def runs():
            # The driver sends a command only when a pin changes.
            for on in (0, 1):
                spindle.set(spindle_on=on)
                time.sleep(1)
            return drive.motor.running

        spindle.wait_for(runs)
        spindle.wait_for(lambda: spindle.get("frequency-out") == drive.motor.target_hz > 20)
        spindle.set(spindle_on=0)
        spindle.wait_for(lambda: spindle.get("frequency-out") == 0)
        assert not drive.motor.running


def test_wj200_vfd_runs_a_hitachi_in_both_directions_and_resets_its_trip(tmp_path):
    drive = virtual_drive("modbus", 1, model="hitachi-wj200")
    with served(drive, tmp_path) as (line, trip):
        options = f"--device {line} --baud 9600 --parity none --databits 8 --stopbits 1"
        with driver(tmp_path, "wj200_vfd", f"wj200_vfd {options}", pins="wj200-vfd.0") as spindle:
            spindle.set(enable=1, commanded_frequency=25, mbslaveaddr=1, run=1)
            spindle.wait_for(lambda: spindle.get("is-at-speed") and spindle.get("motor-current") > 0)
            assert drive.motor.target_hz == drive.motor.output_hz == 25.0
            assert [spindle.get(pin) for pin in ("is-running", "is-ready", "is-at-speed", "is-alarm")] == [
                True, True, True, False,
            ]  # fmt: skip
            spindle.set(run=0)
            spindle.wait_for(lambda: spindle.get("is-running") is False)
            spindle.set(reverse=1, run=1)
            spindle.wait_for(lambda: drive.motor.output_hz < -20)
            trip(3)
            # An enabled driver resets a drive that has a fault.
            spindle.wait_for(lambda: spindle.get("is-alarm") is False and not drive.motor.fault)
            spindle.set(run=0)
            spindle.wait_for(lambda: spindle.get("is-running") is False)
            assert not drive.motor.running


def test_vfdb_vfd_runs_an_older_delta_and_shows_its_values(tmp_path):
    drive = virtual_drive("modbus", 1, model="delta-vfd-b")
    with served(drive, tmp_path) as (line, _):
        command = f"vfdb_vfd -n delta -S VFD-B -I {ini(tmp_path, line, 'VFD-B')}"
        with driver(tmp_path, "delta", command) as spindle:
            spindle.set(speed_command=750, enable=1, spindle_on=1)
            spindle.wait_for(lambda: spindle.get("frequency-out") == 25.0)
            assert drive.motor.target_hz == 25.0
            assert int(spindle.get("status")) & 3 == 3
            assert spindle.get("frequency-limit") == 60.0
            spindle.wait_for(lambda: spindle.get("output-current") > 0)
            spindle.set(speed_command=-750)
            spindle.wait_for(lambda: drive.motor.output_hz < -24)
            spindle.set(spindle_on=0)
            spindle.wait_for(lambda: spindle.get("is-stopped"))
            assert not drive.motor.running
            assert spindle.get("error-count") == 0


def test_vfs11_vfd_runs_a_toshiba_and_resets_its_trip(tmp_path):
    drive = virtual_drive("modbus", 1, model="toshiba-vfs11")
    with served(drive, tmp_path) as (line, trip):
        command = f"vfs11_vfd -n toshiba -S VFS11 -I {ini(tmp_path, line, 'VFS11')}"
        with driver(tmp_path, "toshiba", command) as spindle:
            spindle.set(speed_command=705, enable=1, spindle_on=1)
            spindle.wait_for(lambda: spindle.get("frequency-out") > 20)
            wanted = spindle.get("frequency-command")
            spindle.wait_for(lambda: spindle.get("frequency-out") == wanted)
            assert drive.motor.target_hz == pytest.approx(wanted)
            assert spindle.get("frequency-limit") == 60.0
            trip(4)
            spindle.wait_for(lambda: spindle.get("trip-code") == 4)
            spindle.set(spindle_on=0)
            spindle.set(err_reset=1)
            spindle.wait_for(lambda: spindle.get("trip-code") == 0 and not drive.motor.fault)
            spindle.set(spindle_on=1)
            spindle.wait_for(lambda: spindle.get("frequency-out") > 20)
            spindle.set(spindle_on=0)
            spindle.wait_for(lambda: spindle.get("is-stopped"))
            assert not drive.motor.running


def test_hy_vfd_runs_a_huanyang_in_both_directions_and_shows_its_values(tmp_path):
    drive = virtual_drive("huanyang", 1)
    with (
        served(drive, tmp_path) as (line, _),
        driver(tmp_path, "hy_vfd", f"hy_vfd -d {line} -r 9600 -p none -s 1 -b 8 -t 1") as spindle,
    ):
        spindle.set(speed_command=720, spindle_forward=1, spindle_on=1, enable=1)
        # 1440 rpm at 50 Hz; the driver requests one revolution more, and truncates to 0.01 Hz.
        spindle.wait_for(lambda: spindle.get("OutF") == pytest.approx(25.03))
        assert drive.motor.target_hz == pytest.approx(25.03)
        assert (spindle.get("max-freq"), spindle.get("motor-poles")) == (50.0, 4)
        assert spindle.get("rated-motor-current") == pytest.approx(7.0)
        spindle.wait_for(lambda: spindle.get("OutA") > 0 and spindle.get("SetF") == pytest.approx(25.03))
        spindle.wait_for(lambda: spindle.get("CNST-run") and spindle.get("CNST-running"))
        assert not spindle.get("CNST-running-rf")
        spindle.set(spindle_forward=0, spindle_reverse=1)
        spindle.wait_for(lambda: drive.motor.output_hz < -24)
        spindle.wait_for(lambda: spindle.get("CNST-running-rf"))
        spindle.set(spindle_on=0)
        spindle.wait_for(lambda: not drive.motor.running)
        spindle.wait_for(lambda: spindle.get("OutF") == 0 and not spindle.get("CNST-running"))
        assert spindle.get("hycomm-ok")
        assert spindle.get("error-count") == 0
