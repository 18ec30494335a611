"""A watchdog that only commands feed: the words that are repeated to a kept Danfoss drive, and those that never are."""

import pytest

import drivecomm
from drivecomm.bus import keep
from drivecomm.protocol import Command, DriveState
from drivecomm.virtual import VirtualLine, virtual_drive

START, STOP = "01 10 C3 4F 00 01 02 04 7C", "01 10 C3 4F 00 01 02 04 3C"


@pytest.fixture
def plant():
    drive = virtual_drive("modbus", 1, model="danfoss-fc")
    line, sent = VirtualLine([drive]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        yield drive, line, bus.drive("modbus", 1, model="danfoss-fc"), sent


def commands(sent):
    telegrams = [each.data[:-2].hex(" ").upper() for each in sent if each.what == "sent"]
    return [each for each in telegrams if each.startswith("01 10 C3 4F")]


def test_held_command_is_repeated_while_the_motor_is_kept(plant):
    drive, _, fan, sent = plant
    fan.set_reference(percent=50)
    with keep(fan, "trip", watchdog_s=2) as kept:
        kept.sleep(5)
        assert set(commands(sent)) == {STOP}
        fan.start()
        del sent[:]
        kept.sleep(10)
        assert drive.motor.running
        assert not drive.motor.fault
        assert set(commands(sent)) == {START}
        assert 10 <= len(commands(sent)) <= 40


def test_drive_trips_if_it_receives_only_reads(plant):
    drive, line, fan, _ = plant
    drive.poke("8030", 10)
    drive.poke("8040", 5)
    fan.set_reference(percent=50)
    fan.start()
    for _ in range(10):
        line.advance(0.2)
        fan.read("output_frequency")
    assert fan.status().fault


def test_invalid_control_words_do_not_feed_the_watchdog(plant):
    drive, line, fan, _ = plant
    drive.poke("8030", 10)
    drive.poke("8040", 5)
    fan.set_reference(percent=50)
    fan.start()
    for _ in range(10):
        line.advance(0.2)
        fan.write("50000", 0)
    assert drive.motor.fault


def test_command_is_not_repeated_without_a_watchdog(plant):
    _, line, fan, sent = plant
    fan.set_reference(percent=50)
    fan.start()
    del sent[:]
    for _ in range(3):
        line.advance(1)
        assert fan.status().running
    assert commands(sent) == []


@pytest.mark.parametrize("word", [0x043C, 0x0474])
def test_motor_stopped_by_another_master_is_not_restarted(plant, word):
    drive, line, fan, sent = plant
    fan.set_reference(percent=50)
    with keep(fan, "trip", watchdog_s=2) as kept:
        fan.start()
        kept.sleep(3)
        # The stop of another master: nothing here has sent it, and the motor still turns for a while.
        drive.poke("50000", word)
        drive.motor.stop(Command.RAMP_STOP, line.time)
        del sent[:]
        kept.sleep(1)
        assert START not in commands(sent)


def test_tripped_motor_is_not_started_by_its_reset(plant):
    drive, line, fan, sent = plant
    fan.set_reference(percent=50)
    with keep(fan, "trip", watchdog_s=2) as kept:
        fan.start()
        kept.sleep(3)
        drive.trip(13, line.time)
        del sent[:]
        kept.sleep(1)
        fan.reset()
        kept.sleep(5)
        assert START not in commands(sent)
        assert fan.status().state is DriveState.READY
