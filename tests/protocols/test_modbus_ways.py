"""Starts through the states of a drive: they begin at the present state and await each next one."""

from itertools import pairwise

import pytest

import drivecomm
from drivecomm.errors import StateError
from drivecomm.protocol import Command, DriveState
from drivecomm.virtual import VirtualLine, virtual_drive

WORDS = {
    "bonfiglioli": ("410", "411", [0x0006, 0x0007, 0x000F]),
    "schneider-atv": ("8501", "3201", [0x0006, 0x0007, 0x000F]),
    "abb-acs355": ("40001", "40004", [0x0406, 0x0407, 0x040F, 0x043F, 0x047F]),
    "abb-acs580": ("400001", "400004", [0x0406, 0x0407, 0x040F, 0x043F, 0x047F]),
    "siemens-g120": ("40100", "40110", [0x047E, 0x047F]),
}


@pytest.fixture
def plant(name):
    drive = virtual_drive("modbus", 1, model=name)
    line, sent = VirtualLine([drive]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        one = bus.drive("modbus", 1, model=name)
        one.set_reference(**({"hz": 20} if one.capabilities.reference_hz else {"percent": 40}))
        yield drive, line, one, sent


def words(sent, since=0):
    return [
        int.from_bytes(each.data[-4:-2]) for each in sent[since:] if each.what == "sent" and each.data[1] in (6, 16)
    ]


@pytest.mark.parametrize("name", WORDS)
def test_start_awaits_each_state_of_the_drive(name, plant):
    drive, _, one, sent = plant
    before = len(sent)
    one.start()
    assert words(sent, before) == WORDS[name][2]
    asked = [each.data[1] for each in sent[before:] if each.what == "sent"]
    steps = [number for number, function in enumerate(asked) if function in (6, 16)]
    assert all(function == 3 for number, function in enumerate(asked) if number not in steps)
    assert all(later - sooner > 1 for sooner, later in pairwise(steps))
    assert drive.motor.command is Command.RUN


@pytest.mark.parametrize("name", WORDS)
def test_start_of_a_running_motor_sends_only_the_last_word(name, plant):
    drive, line, one, sent = plant
    one.start()
    line.advance(30)
    before = len(sent)
    one.start()
    assert words(sent, before) == WORDS[name][2][-1:]
    if one.capabilities.reverse:
        one.start(reverse=True)
        assert words(sent, before)[1:] == [0x0C7F]
        line.advance(30)
        assert one.status().running
        assert drive.motor.target_hz < 0


@pytest.mark.parametrize("name", WORDS)
def test_start_sends_no_further_step_if_the_drive_does_not_follow(name, plant):
    drive, _, one, sent = plant
    machine = drive._machine
    machine._orders.written = lambda *_: None
    before = len(sent)
    with pytest.raises(StateError, match="did not come to"):
        one.start()
    assert words(sent, before) == WORDS[name][2][:1]


@pytest.mark.parametrize("name", [*WORDS, "siemens-v20"])
def test_drive_is_ready_after_a_stop(plant):
    _, line, one, _ = plant
    one.start()
    line.advance(1)
    assert one.status().state is DriveState.RUNNING
    one.stop()
    one.wait_for(DriveState.READY, timeout_s=30)


@pytest.mark.parametrize("name", [*WORDS, "siemens-v20"])
def test_virtual_drive_shows_the_status_words_of_its_standard(name, plant):
    drive, line, one, _ = plant
    status = WORDS.get(name, ("", "40110"))[1]
    mask = 0x6F if name in ("bonfiglioli", "schneider-atv") else 0x7F
    voltage = mask & 0x10
    # While ramping down: "switched on" with CiA 402, OFF1 active with ABB, still "operation" with PROFIdrive.
    ramping = {"bonfiglioli": 0x23, "schneider-atv": 0x23, "abb-acs355": 0x25, "abb-acs580": 0x25}.get(name, 0x27)

    def shown():
        return drive.peek(status, line.time) & mask

    # Bit 4 means no OFF2. The first control word 0000 is OFF2; that of a V20 starts with another value.
    assert shown() == (0x40 if name in WORDS else 0x31)
    one.start()
    line.advance(10)
    assert shown() == 0x27 | voltage
    one.stop()
    line.advance(1)
    assert shown() == ramping | voltage
    line.advance(60)
    assert shown() & ~0x02 == 0x21 | voltage
    drive.trip(3, line.time)
    assert shown() & 0x4F == 0x08


@pytest.mark.parametrize("word", [0xE231, 0xEB31, 0xFB33])
@pytest.mark.parametrize("name", ["siemens-g120", "siemens-v20"])
def test_status_word_of_a_standing_siemens_drive_means_ready(plant, word):
    drive, _, one, _ = plant
    drive._machine.live = lambda _: None
    drive.poke("40110", word)
    assert one.status().state is DriveState.READY


@pytest.mark.parametrize("name", ["delta", "gs2", "delta-vfd-b", "delta-vfd-e"])
def test_delta_drive_shows_the_actual_and_the_ordered_direction(name, plant):
    """Bits 3 and 4: 00 FWD, 01 REV to FWD, 10 FWD to REV, 11 REV (MS300 manual p. 790, GS4 manual p. D-14)."""
    drive, line, one, _ = plant

    def shown():
        return drive.peek("0x2119" if name == "delta" else "0x2101", line.time) >> 3 & 0b11, one.status().reverse

    assert shown() == (0b00, False)
    one.start()
    line.advance(10)
    assert shown() == (0b00, False)
    one.start(reverse=True)
    assert shown() == (0b10, False)
    line.advance(20)
    assert shown() == (0b11, True)
    one.start()
    assert shown() == (0b01, True)
    line.advance(20)
    assert shown() == (0b00, False)
    one.start(reverse=True)
    line.advance(20)
    one.stop()
    line.advance(0.5)
    assert shown() == (0b11, True)
