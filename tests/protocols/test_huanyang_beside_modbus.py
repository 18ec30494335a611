"""Huanyang and Modbus drives on one line: telegrams of one protocol that are valid in the other, and their effects."""

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
    """Return the requests that a codec of this protocol finds in these bytes, for any address."""
    framer = Framer(plugin.codec(plugin.options()), "request")
    return [find.message for find in (*framer.feed(data), *framer.flush()) if isinstance(find, Framed)]


def tell(drive, data):
    """Pass bytes and a following silence to a virtual drive; return its replies."""
    framer = Framer(drive.codec, "request")
    finds = [find for find in (*framer.feed(data), *framer.flush()) if not isinstance(find, Noise)]
    answers = [drive.hear(find, 1.0) for find in finds]
    return [answer.data for answer in answers if answer is not None]


# Modbus telegrams as a Huanyang drive receives them


@pytest.mark.soak
def test_no_register_read_starts_with_valid_control_data():
    """Register and count of such a read would be LEN 1, CNTR and their CRC; that CRC is never a valid count."""
    for address, word in product(HUANYANG.addresses, range(256)):
        control = closed(bytes((address, 0x03, 0x01, word)))
        assert taken(HUANYANG, control)[0].kind == "control"
        assert int.from_bytes(control[4:]) not in range(1, MOST_REGISTERS + 1)


def test_register_read_at_address_252_would_be_control_data():
    """No Huanyang drive can have address 252; there a read of register 0101H and others would be control data."""
    assert closed(bytes.fromhex("FC030101")) == bytes.fromhex("FC0301010024")
    assert closed(bytes.fromhex("FC0301010024")) == bytes.fromhex("FC03010100240000")
    assert max(HUANYANG.addresses) == 250


@pytest.mark.soak
@pytest.mark.parametrize("address", [1, 3, 5, 250])
def test_register_read_contains_no_control_data(address):
    """Check by LEN and CRC, from any byte of the read on and for any drive."""
    for start in (*range(0x400), *range(0x400, 0x10000, 0x101)):
        for count in (1, 2, 49, MOST_REGISTERS):
            data = closed(bytes((address, 0x03)) + start.to_bytes(2) + count.to_bytes(2))
            assert not any(message.kind == "control" for message in taken(HUANYANG, data))


def test_read_of_register_0301h_neither_starts_the_drive_nor_is_answered():
    """The read has LEN 3 and a valid CRC. No page says how a real drive reacts, so a virtual one ignores it."""
    data = closed(bytes.fromhex("010303010001"))
    drive = virtual_drive("huanyang", 1)
    assert tell(drive, data) == []
    assert drive.motor.command is not Command.RUN


@pytest.mark.parametrize(("number", "count"), [(5, 1), (1, 2), (183, MOST_BITS)])
def test_read_of_discrete_inputs_from_0300h_is_a_parameter_write(number, count):
    data = closed(bytes((1, 0x02, 0x03, number)) + count.to_bytes(2))
    (message,) = taken(HUANYANG, data)
    assert (message.kind, message.parameter, message.value) == ("write", number, count)
    assert drivecomm.decode("modbus", data, direction="request").kind == "read_inputs"


def test_read_of_discrete_inputs_changes_a_huanyang_parameter():
    """The write makes the terminals the command source: if one of them is closed, the motor may start."""
    drive = virtual_drive("huanyang", 1)
    assert drive.peek("PD001", 1.0) == 2
    assert tell(drive, closed(bytes.fromhex("010203010001")))
    assert drive.peek("PD001", 1.0) == 1


def test_coil_write_may_be_a_frequency_by_chance():
    """A drive that follows LEN reads the first seven of eight bytes as 197.11 Hz; this starts no motor."""
    data = closed(bytes.fromhex("0405024CFF00"))
    (message,) = taken(HUANYANG, data)
    assert (message.kind, message.value) == ("frequency", 0x4CFF)
    assert drivecomm.decode("modbus", data, direction="request").kind == "write_coil"


# Huanyang telegrams as a Modbus drive receives them


def every_huanyang_request(address):
    """Yield all control data, and the other requests with a range of values."""
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
def test_huanyang_request_is_at_most_a_read_for_a_modbus_drive(address):
    found = [message for data in every_huanyang_request(address) for message in taken(MODBUS, closed(data))]
    assert found
    assert {message.function for message in found} <= READS
    assert {MODBUS.intent(message).access for message in found} == {"read"}


@pytest.mark.soak
@pytest.mark.parametrize("model", some(4, MODELS))
def test_huanyang_requests_do_not_change_a_modbus_drive_at_the_same_address(model):
    drive = virtual_drive("modbus", 5, model=model)
    names = [info.address for info in load_model(MODBUS.package, "modbus", model).parameters.values()]
    before = {each: drive.peek(each, 1.0) for each in names}
    for data in every_huanyang_request(5):
        tell(drive, closed(data))
    assert drive.motor.command is not Command.RUN
    assert {each: drive.peek(each, 1.0) for each in names} == before


# Telegrams of a scan


def modbus_drive(address, model):
    """Return a drive with the line settings that a scan uses."""
    return virtual_drive("modbus", address, model=model, **asdict(MODBUS.facts.settings))


def scanned(protocols, *drives, addresses=None):
    line, sent = VirtualLine(list(drives)), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        found = list(bus.scan(protocols, addresses))
    assert not any(drive.motor.running or drive.motor.command is Command.RUN for drive in drives)
    return found, [event.data for event in sent if event.what == "sent"]


@pytest.mark.soak
def test_modbus_scan_sends_no_huanyang_control_data():
    """Check drives that follow LEN and CRC, and drives that ignore LEN: for those CNTR is the low register byte, 0.

    Further registers are read only from a Modbus drive that has given a valid reply.
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
def test_full_scan_identifies_each_protocol_and_starts_no_motor(name):
    drive = virtual_drive("huanyang", 5) if name == "huanyang" else modbus_drive(5, "delta")
    found, sent = scanned(None, drive, addresses=range(4, 7))
    assert [each.name for each in found if each.sound] == [f"{name}:5"]
    assert not any(HUANYANG.intent(message).commands for data in sent for message in taken(HUANYANG, data))


def test_huanyang_scan_sends_no_valid_modbus_request():
    _, sent = scanned(["huanyang"], virtual_drive("modbus", 5, model="delta"))
    assert len(sent) >= len(HUANYANG.scan_addresses)
    assert [message for data in sent for message in taken(MODBUS, data)] == []


# Telegrams as the sniffer reads them


def told(*telegrams, names=("danfoss-fc", "fuji", "huanyang", "modbus", "uss", "vabus", "vlt3500")):
    sniffer = Sniffer([installed[name] for name in names])
    pieces = [Piece(time_s=1.0 + place / 10, data=bytes.fromhex(data)) for place, data in enumerate(telegrams)]
    return [item for piece in pieces for item in sniffer.feed(piece)] + sniffer.finish()


WRITE, STATUS, VALUE = "010203050001A98F", "010401018049", "010403010000A18E"


def test_sniffer_reports_a_telegram_of_both_protocols_as_ambiguous():
    """A write of PD005 and its reply are two reads of inputs as well; a status value fits one protocol only."""
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
def test_sniffer_of_one_protocol_reads_the_telegrams_as_that_protocol(name, telegrams, kinds):
    heard = told(*telegrams, names=(name,))
    assert [(item.protocol, item.message.kind) for item in heard] == [(name, kind) for kind in kinds]


def test_sniffer_reads_control_data_as_huanyang_only():
    heard = told("010301013188", "01030109304E", "01030108F18E", "01030108F18E")
    assert {item.protocol for item in heard if isinstance(item, HeardTelegram)} == {"huanyang"}


def test_telegram_of_both_protocols_is_decoded_by_each():
    data = bytes.fromhex("010203050001A98F")
    for name, kind in (("huanyang", "write"), ("modbus", "read_inputs")):
        assert drivecomm.decode(name, data, direction="request").kind == kind
    with pytest.raises(TelegramError):
        drivecomm.decode("modbus", bytes.fromhex("010301013188"), direction="request")
