"""Huanyang and Modbus drives on one line: which telegrams of the one are telegrams of the other, and what they do."""

from dataclasses import asdict
from itertools import product

import pytest
from extents import some

import drivecomm
from drivecomm.capture import Piece
from drivecomm.errors import TelegramError
from drivecomm.models import load_model, model_names
from drivecomm.protocol import Command, Framed, Framer, Noise, installed
from drivecomm.protocol.schema import crc16
from drivecomm.traffic.sniffer import AmbiguousTelegram, HeardTelegram, Sniffer
from drivecomm.virtual import VirtualLine, virtual_drive

HUANYANG, MODBUS = installed["huanyang"], installed["modbus"]
MOST_REGISTERS, MOST_BITS = 125, 2000
READS = {0x01, 0x02, 0x03, 0x04}
MODELS = model_names(MODBUS.package, "modbus")


def closed(data):
    return data + crc16(data)


def taken(plugin, data):
    """The requests that a drive of this protocol finds in these bytes, whoever they are for."""
    framer = Framer(plugin.codec(plugin.options()), "request")
    return [find.message for find in (*framer.feed(data), *framer.flush()) if isinstance(find, Framed)]


def tell(drive, data):
    """Let a virtual drive hear this, and silence after it; return what it answers."""
    framer = Framer(drive.codec, "request")
    finds = [find for find in (*framer.feed(data), *framer.flush()) if not isinstance(find, Noise)]
    answers = [drive.hear(find, 1.0) for find in finds]
    return [answer.data for answer in answers if answer is not None]


# What a Huanyang drive hears of Modbus


@pytest.mark.soak
def test_no_read_of_holding_registers_begins_with_control_data_for_any_drive():
    """Its register would be LEN 1 and CNTR, and its count their CRC, which is no count that a read can have."""
    for address, word in product(HUANYANG.addresses, range(256)):
        control = closed(bytes((address, 0x03, 0x01, word)))
        assert taken(HUANYANG, control)[0].kind == "control"
        assert int.from_bytes(control[4:]) not in range(1, MOST_REGISTERS + 1)


def test_why_that_depends_on_the_addresses():
    """At 252, which no Huanyang drive can have, there are such reads, of registers 0101H and others."""
    assert closed(bytes.fromhex("FC030101")) == bytes.fromhex("FC0301010024")
    assert closed(bytes.fromhex("FC0301010024")) == bytes.fromhex("FC03010100240000")
    assert max(HUANYANG.addresses) == 250


@pytest.mark.soak
@pytest.mark.parametrize("address", [1, 3, 5, 250])
def test_no_read_of_holding_registers_is_control_data(address):
    """By LEN and CRC; from anywhere in it, for any drive."""
    for start in (*range(0x400), *range(0x400, 0x10000, 0x101)):
        for count in (1, 2, 49, MOST_REGISTERS):
            data = closed(bytes((address, 0x03)) + start.to_bytes(2) + count.to_bytes(2))
            assert not any(message.kind == "control" for message in taken(HUANYANG, data))


def test_a_read_of_0301h_is_whole_by_its_len_and_is_no_control_data_here():
    """LEN 3 and a right CRC: what a real drive makes of it no page says, so that no virtual one answers or runs."""
    data = closed(bytes.fromhex("010303010001"))
    drive = virtual_drive("huanyang", 1)
    assert tell(drive, data) == []
    assert drive.motor.command is not Command.RUN


@pytest.mark.parametrize(("number", "count"), [(5, 1), (1, 2), (183, MOST_BITS)])
def test_a_read_of_discrete_inputs_from_0300h_writes_a_parameter(number, count):
    data = closed(bytes((1, 0x02, 0x03, number)) + count.to_bytes(2))
    (message,) = taken(HUANYANG, data)
    assert (message.kind, message.parameter, message.value) == ("write", number, count)
    assert drivecomm.decode("modbus", data, direction="request").kind == "read_inputs"


def test_such_a_write_reaches_the_drive():
    """Commands come from the terminals from then on: where one is closed, the motor may start."""
    drive = virtual_drive("huanyang", 1)
    assert drive.peek("PD001", 1.0) == 2
    assert tell(drive, closed(bytes.fromhex("010203010001")))
    assert drive.peek("PD001", 1.0) == 1


def test_a_coil_can_be_a_frequency_by_chance():
    """A drive that goes by LEN hears the first seven of eight bytes: 197.11 Hz for a motor that runs; none starts."""
    data = closed(bytes.fromhex("0405024CFF00"))
    (message,) = taken(HUANYANG, data)
    assert (message.kind, message.value) == ("frequency", 0x4CFF)
    assert drivecomm.decode("modbus", data, direction="request").kind == "write_coil"


# What a Modbus drive hears of Huanyang


def every_huanyang_request(address):
    """All control data, and the other requests with values of every kind."""
    start = bytes((address,))
    yield from (start + bytes((0x03, 1, word)) for word in range(256))
    yield from (start + bytes((0x05, 2)) + hz.to_bytes(2) for hz in range(0, 0x10000, 0x3D))
    yield from (start + bytes((0x05, 2)) + hz.to_bytes(2) for hz in (0xFF00, 0x00FF, 0xFFFF))
    for number in range(256):
        yield start + bytes((0x01, 1, number))
        yield start + bytes((0x01, 3, number, 0, 0))
        yield from (start + bytes((0x02, 2, number, value)) for value in (0, 1, 2, 0xFF))
        yield from (start + bytes((0x02, 3, number)) + value.to_bytes(2) for value in (0, 1, 2, 125, 2000, 40000))
    for item in range(8):
        yield start + bytes((0x04, 1, item))
        yield start + bytes((0x04, 3, item, 0, 0))


@pytest.mark.parametrize("address", [1, 5, 247])
def test_whatever_a_huanyang_drive_is_told_a_modbus_drive_takes_for_a_read_at_most(address):
    found = [message for data in every_huanyang_request(address) for message in taken(MODBUS, closed(data))]
    assert found
    assert {message.function for message in found} <= READS
    assert {MODBUS.intent(message).access for message in found} == {"read"}


@pytest.mark.soak
@pytest.mark.parametrize("model", some(4, MODELS))
def test_a_modbus_drive_of_the_same_number_is_neither_started_nor_changed(model):
    drive = virtual_drive("modbus", 5, model=model)
    names = [info.address for info in load_model(MODBUS.package, "modbus", model).parameters.values()]
    before = {each: drive.peek(each, 1.0) for each in names}
    for data in every_huanyang_request(5):
        tell(drive, closed(data))
    assert drive.motor.command is not Command.RUN
    assert {each: drive.peek(each, 1.0) for each in names} == before


# What a scan sends


def modbus_drive(address, model):
    """A drive with the settings that a scan asks with."""
    return virtual_drive("modbus", address, model=model, **asdict(MODBUS.facts.settings))


def scanned(protocols, *drives, addresses=None):
    line, sent = VirtualLine(list(drives)), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        found = list(bus.scan(protocols, addresses))
    assert not any(drive.motor.running or drive.motor.command is Command.RUN for drive in drives)
    return found, [event.data for event in sent if event.what == "sent"]


@pytest.mark.soak
def test_a_scan_for_modbus_sends_no_control_data_however_a_huanyang_drive_reads_them():
    """Neither by LEN and CRC, nor to a drive that ignores LEN: CNTR would be the register's low byte, which is 0.

    Further registers are asked for only where a Modbus drive has answered soundly.
    """
    drives = [modbus_drive(2 + number, model) for number, model in enumerate(some(4, MODELS))]
    found, sent = scanned(["modbus"], virtual_drive("huanyang", 1), *drives)
    assert {each.address for each in found} == {drive.address for drive in drives}
    assert {data[0] for data in sent} == set(MODBUS.scan_addresses)
    answered = {drive.address for drive in drives}
    for data in sent:
        assert not any(HUANYANG.intent(message).commands for message in taken(HUANYANG, data))
        assert data[1] not in (0x02, 0x05)
        assert data[0] in answered or data[1] != 0x03 or data[2:4] == b"\0\0"


@pytest.mark.parametrize("name", ["huanyang", "modbus"])
def test_a_scan_for_everybody_takes_neither_for_the_other_and_starts_none(name):
    drive = virtual_drive("huanyang", 5) if name == "huanyang" else modbus_drive(5, "delta")
    found, sent = scanned(None, drive, addresses=range(4, 7))
    assert [each.name for each in found if each.sound] == [f"{name}:5"]
    assert not any(HUANYANG.intent(message).commands for data in sent for message in taken(HUANYANG, data))


def test_a_scan_for_huanyang_drives_only_reads_for_whoever_hears_it():
    _, sent = scanned(["huanyang"], virtual_drive("modbus", 5, model="delta"))
    assert len(sent) >= len(HUANYANG.scan_addresses)
    assert [message for data in sent for message in taken(MODBUS, data)] == []


# What listeners say


def told(*telegrams, names=("danfoss-fc", "fuji", "huanyang", "modbus", "uss", "vabus", "vlt3500")):
    sniffer = Sniffer([installed[name] for name in names])
    pieces = [Piece(time_s=1.0 + place / 10, data=bytes.fromhex(data)) for place, data in enumerate(telegrams)]
    return [item for piece in pieces for item in sniffer.feed(piece)] + sniffer.finish()


WRITE, STATUS, VALUE = "010203050001A98F", "010401018049", "010403010000A18E"


def test_the_sniffer_claims_no_telegram_that_either_protocol_has():
    """A write of PD005 and its reply are a read of inputs twice; a status value is of one protocol only."""
    heard = told(WRITE, WRITE, STATUS, VALUE)
    assert [type(item) for item in heard] == [AmbiguousTelegram] * 2 + [HeardTelegram] * 2
    assert [item.protocol for item in heard[2:]] == ["huanyang"] * 2


@pytest.mark.parametrize(
    ("name", "telegrams", "kinds"),
    [
        ("huanyang", (STATUS, VALUE, WRITE, WRITE), ["status", "status", "write", "write"]),
        ("modbus", (WRITE, "01020100A188", WRITE, "01020100A188"), ["read_inputs"] * 4),
    ],
)
def test_the_sniffer_knows_them_once_it_is_told_who_is_there(name, telegrams, kinds):
    heard = told(*telegrams, names=(name,))
    assert [(item.protocol, item.message.kind) for item in heard] == [(name, kind) for kind in kinds]


def test_control_data_are_no_modbus_for_the_sniffer():
    heard = told("010301013188", "01030109304E", "01030108F18E", "01030108F18E")
    assert {item.protocol for item in heard if isinstance(item, HeardTelegram)} == {"huanyang"}


def test_decode_names_every_protocol_that_a_telegram_fits():
    data = bytes.fromhex("010203050001A98F")
    for name, kind in (("huanyang", "write"), ("modbus", "read_inputs")):
        assert drivecomm.decode(name, data, direction="request").kind == kind
    with pytest.raises(TelegramError):
        drivecomm.decode("modbus", bytes.fromhex("010301013188"), direction="request")
