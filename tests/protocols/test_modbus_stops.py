"""Stops of drives whose control word may act as contacts, where a stop by the state machine could start the motor."""

import pytest

import drivecomm
from drivecomm.errors import NoReplyError
from drivecomm.protocol import Stop
from drivecomm.virtual import VirtualLine, virtual_drive

RAMP, QUICK, SURE = "01 10 01 9A 00 01 02 00 07", "01 10 01 9A 00 01 02 00 02", "01 10 01 9A 00 01 02 00 00"


@pytest.fixture
def plant():
    drive = virtual_drive("modbus", 1, model="bonfiglioli")
    line, sent = VirtualLine([drive]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        yield drive, line, bus, sent


def written(sent):
    return [each.data[:-2].hex(" ").upper() for each in sent if each.what == "sent" and each.data[1] == 0x10]


@pytest.mark.parametrize(
    ("how", "telegram"), [(Stop.RAMP, RAMP), (Stop.QUICK, QUICK), (Stop.COAST, SURE)], ids=["ramp", "quick", "coast"]
)
@pytest.mark.parametrize("mode", [1, 2])
def test_stop_sends_0000_if_the_control_word_may_act_as_contacts(plant, how, telegram, mode):
    drive, _, bus, sent = plant
    drive.poke("412", mode)
    bus.drive("modbus", 1, model="bonfiglioli").stop(how)
    assert written(sent) == [telegram if mode == 1 else SURE]


def test_broadcast_stop_sends_0000(plant):
    _, _, bus, sent = plant
    bus.broadcast("modbus", model="bonfiglioli").stop(Stop.QUICK)
    assert written(sent) == ["00" + SURE[2:]]


def test_stop_sends_0000_if_the_mode_of_the_drive_is_unreadable(plant):
    drive, _, bus, sent = plant
    hear = drive.hear
    drive.hear = lambda find, now: hear(find, now) if b"\x01\x9c" not in find.data else None
    bus.drive("modbus", 1, model="bonfiglioli").stop()
    assert SURE in written(sent)
    assert RAMP not in written(sent)


def test_stop_after_an_unanswered_request_is_sent_without_a_read(plant):
    drive, line, bus, sent = plant
    one = bus.drive("modbus", 1, model="bonfiglioli")
    line.power_off(drive)
    with pytest.raises(NoReplyError):
        one.status()
    line.power_on(drive)
    del sent[:]
    one.stop()
    assert written(sent)[0] == SURE
    assert next(each for each in sent if each.what == "sent").data[1] == 0x10
