"""Danfoss FC drives on a disturbed line: a reading is either the value of the drive or a DriveCommError."""

from random import Random

import pytest

import drivecomm
from drivecomm.errors import DriveCommError, NoReplyError
from drivecomm.plant import Fault, FaultPlan
from drivecomm.virtual import VirtualLine, virtual_drive

PARAMETERS = ("3-41", "3-10[1]", "3-10[3]", "15-02", "15-40", "3-02", "8-04", "16-03", "0-37", "15-30[0]")


def disturbed(seed, **more):
    drives = [virtual_drive("danfoss-fc", address) for address in (3, 4)]
    line = VirtualLine(drives, faults=FaultPlan(rate=0.1, seed=seed, **more))
    return drives, line


@pytest.mark.soak
def test_readings_on_a_disturbed_line_are_right_or_errors():
    drives, line = disturbed(5)
    random = Random(5)
    good = 0
    with drivecomm.open_bus(line.port) as bus:
        masters = [bus.drive("danfoss-fc", drive.address, model="fc300") for drive in drives]
        for _ in range(2000):
            place = random.randrange(2)
            parameter = random.choice(PARAMETERS)
            try:
                reading = masters[place].read(parameter)
            except DriveCommError:
                continue
            good += 1
            assert reading.raw == drives[place].peek(parameter, line.time), parameter
    assert good > 1900


@pytest.mark.soak
def test_writes_on_a_disturbed_line_are_never_confirmed_falsely():
    drives, line = disturbed(6, delay_s=0.2)
    random = Random(6)
    good = 0
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive("danfoss-fc", 3, model="fc300")
        for _ in range(1000):
            value = random.randrange(1, 3600)
            try:
                reading = master.write("3-41", value)
            except DriveCommError:
                continue
            good += 1
            assert reading.value == value
            assert reading.note == ""
            assert drives[0].peek("3-41", line.time) == value * 100
    assert good > 900


@pytest.mark.soak
def test_reads_on_a_disturbed_line_never_start_a_motor():
    drives, line = disturbed(7)
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive("danfoss-fc", 3, model="fc300")
        for _ in range(500):
            for verb in (master.status, master.probe, lambda: master.read("16-13")):
                try:
                    verb()
                except DriveCommError:
                    continue
    assert not any(drive.motor.running for drive in drives)


def test_start_without_a_reply_is_not_repeated():
    virtual = virtual_drive("danfoss-fc", 3)
    plan = FaultPlan(rate=0.0, kinds=(Fault.DROP,), requests=False)
    line = VirtualLine([virtual], faults=plan)
    sent = []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        master = bus.drive("danfoss-fc", 3)
        master.status()
        plan.rate = 1.0
        sent.clear()
        with pytest.raises(NoReplyError):
            master.start()
    assert [event.message.control_word for event in sent if event.what == "sent"] == [0, 0, 0]
