"""Lenze drives over LECOM on a virtual line: formats, groups, refusals, damage, and refused commands."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import (
    AddressError,
    DamagedReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
    WrongDriveError,
)
from drivecomm.models import load_model
from drivecomm.protocol import DriveState, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PLUGIN = installed["lecom"]


class Bench:
    def __init__(self, *addresses, model="lenze-82xx"):
        self.drives = [virtual_drive("lecom", address, model=model) for address in addresses or (1,)]
        self.line = VirtualLine(self.drives)
        self.sent = []
        self.bus = drivecomm.open_bus(self.line.port, trace=self._trace)
        self.drive = self.bus.drive("lecom", self.drives[0].address, model=model)

    def _trace(self, event):
        if event.what == "sent":
            self.sent.append(event.data)

    def hears(self, **fields):
        """Return the reply of each drive to a request."""
        data = asked(**fields)
        framed = drivecomm.protocol.Framed(data, PLUGIN.codec(None).decode(data, "request"))
        return [drive.hear(framed, 0.0) for drive in self.drives]


def replies(*data):
    """Return a disturbance that replaces the next replies of a drive, in order."""
    left = list(data)

    class Replies:
        def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
            return [(0.0, data)]

        def reply(self, data, drive, now):  # noqa: ARG002
            return [(0.0, left.pop(0) if left else data)]

    return Replies()


def told(**fields):
    return drivecomm.encode("lecom", fields, direction="reply")


def asked(**fields):
    return drivecomm.encode("lecom", fields, direction="request")


def test_group_telegram_is_obeyed_by_its_drives_without_a_reply():
    bench = Bench(31, 39, 41)
    assert bench.hears(kind="send", address=30, code=11, data="42.5") == [None] * 3
    assert [drive.peek("C0011", 0.0) for drive in bench.drives] == [425, 425, 500]


def test_broadcast_is_obeyed_without_a_reply():
    bench = Bench(1, 99)
    assert bench.hears(kind="send", address=0, code=11, data="42.5") == [None] * 2
    assert [drive.peek("C0011", 0.0) for drive in bench.drives] == [425, 425]


@pytest.mark.parametrize("address", [0, 10, 90, 100])
def test_group_address_is_refused_as_a_drive_address(address):
    bench = Bench()
    with pytest.raises(AddressError, match=r"1 to 99 without 10, 20, 30, 40, 50, 60, 70, 80, 90"):
        bench.bus.drive("lecom", address)


def test_scan_skips_group_addresses():
    bench = Bench(9, 11, 99)
    assert [each.address for each in bench.bus.scan(["lecom"])] == [9, 11, 99]
    assert len(bench.sent) >= 90
    assert not any(data[2:3] == b"0" for data in bench.sent)


def test_value_in_another_format_is_an_unexpected_reply():
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="value", code=11, data="H0032")))
    with pytest.raises(UnexpectedReplyError, match=r"C0011 is H0032, in another format; read it with type=u16"):
        bench.drive.read("C0011")
    assert bench.drive.read("C0011").value == Decimal("50.0")


def test_status_in_another_format_is_an_unexpected_reply():
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="value", code=68, data="2304")))
    with pytest.raises(UnexpectedReplyError):
        bench.drive.status()


def test_read_by_another_type_keeps_the_scale_of_the_code():
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="value", code=68, data="2304")))
    assert bench.drive.read("C0068", type="s32").value == 2304


@pytest.mark.parametrize(
    ("data", "type", "value"),
    [
        ("HFFFF", "s16", -1),
        ("HFF", "u16", 255),
        ("H00010000", "u32", 65536),
        ("-0.5", "s32", Decimal("-0.5")),
        ("S12 V", "string", "12 V"),
        ("O0AFF", "string", "0AFF"),
        ("-214748.3648", "s32", Decimal("-214748.3648")),
    ],
)
def test_unlisted_code_is_read_by_the_given_type(data, type, value):
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="value", code=300, data=data)))
    assert bench.drive.read("C300", type=type).value == value


def test_word_of_32_bits_is_not_truncated_to_16():
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="value", code=68, data="H00010900")))
    with pytest.raises(UnexpectedReplyError, match="type=u32"):
        bench.drive.read("C0068")


def test_unknown_type_is_refused():
    with pytest.raises(UsageError, match="s32, u16, s16, u32, string"):
        Bench().drive.read("C0011", type="f32")


@pytest.mark.parametrize("parameter", ["46", "C", "C123456", "C65536", "C1/256", "P1", "C-1", "c46", "C46/"])
def test_malformed_code_is_refused_with_the_right_form(parameter):
    with pytest.raises(ParameterAddressError, match="write C0046"):
        Bench().drive.read(parameter)


def test_subcodes_and_high_codes_use_extended_addressing():
    bench = Bench()
    for parameter in ("C0410/3", "C6230", "C6229"):
        with pytest.raises(RefusedError, match="no such code"):
            bench.drive.read(parameter)
    assert bench.sent == [b"\x0401!019A03\x05", b"\x0401!185600\x05", b"\x0401u\x7f\x05"]


def test_reply_for_another_subcode_is_rejected():
    bench = Bench()
    bench.line.disturbances.append(
        replies(*[told(kind="value", code=410, subcode=4, extended=True, data="1")] * 3),
    )
    with pytest.raises(drivecomm.ReplyError, match="subcode"):
        bench.drive.read("C0410/3")


def test_request_that_arrived_damaged_is_resent():
    bench = Bench()
    bench.line.disturbances.append(replies(told(kind="fault", code=11)))
    assert bench.drive.read("C0011").value == 50
    assert len(bench.sent) == 2


def test_request_that_always_arrives_damaged_is_sent_three_times():
    bench = Bench()
    bench.line.disturbances.append(replies(*[told(kind="fault", code=11)] * 9))
    with pytest.raises(DamagedReplyError):
        bench.drive.read("C0011")
    assert len(bench.sent) == 3


def test_refused_write_lists_the_possible_causes():
    bench = Bench()
    bench.line.disturbances.append(replies(b"\x15"))
    with pytest.raises(RefusedError, match="outside its range, or it came damaged"):
        bench.drive.write("C0011", 40)
    assert len(bench.sent) == 1


def test_damaged_write_gets_a_nak_from_the_addressed_drive_only():
    bench = Bench(1, 2)
    telegram = bytearray(asked(kind="send", address=1, code=11, data="42"))
    telegram[-1] ^= 1
    (damaged, *_) = drivecomm.protocol.Framer(PLUGIN.codec(None), "request").feed(bytes(telegram))
    first, second = (drive.hear(damaged, 0.0) for drive in bench.drives)
    assert first.data == b"\x15"
    assert second is None
    assert bench.drives[0].peek("C0011", 0.0) == 500


def test_write_with_more_decimals_than_the_model_allows_is_refused():
    bench = Bench()
    with pytest.raises(ValueRefusedError):
        bench.drive.write("C0011", "42.25")
    bench.drive.write("C0011", "42.5")
    assert bench.drives[0].peek("C0011", 0.0) == 425
    assert bench.sent == [asked(kind="send", address=1, code=11, data="42.5")]


@pytest.mark.parametrize("name", ["lenze-82xx", "lenze-9200", "lenze-smv"])
@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.start(reverse=True),
        lambda drive: drive.stop(),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        lambda drive: drive.set_reference(percent=20),
        *[
            lambda drive, code=code: drive.write(code, 1)
            for code in ("C0040", "C0043", "C0135", "C0248", "C40", "C135", "C00135", "controller_enable")
        ],
    ],
)
def test_command_is_refused_unsent(name, command):
    bench = Bench(model=name)
    with pytest.raises(NotSupported, match="monitoring only"):
        command(bench.drive)
    assert not bench.sent


def test_setpoint_write_is_refused_unsent():
    bench = Bench()
    with pytest.raises(NotSupported, match="monitoring only"):
        bench.drive.write("C0046", 10)
    assert not bench.sent


@pytest.mark.parametrize(
    ("word", "state", "fault", "reverse"),
    [
        ("H0900", DriveState.RUNNING, False, False),
        ("H0D00", DriveState.RUNNING, False, True),
        ("H0100", DriveState.READY, False, False),
        ("H0800", DriveState.READY, False, False),
        ("H8900", DriveState.FAULT, True, False),
    ],
)
def test_operating_state_is_read_as_in_the_manual(word, state, fault, reverse):
    bench = Bench()
    bench.line.disturbances.append(replies(*[told(kind="value", code=68, data=word)] * 4))
    status = bench.drive.status()
    assert (status.state, status.fault) == (state, fault)
    assert not status.running or status.reverse == reverse


@pytest.mark.parametrize("name", ["lenze-9200", "lenze-smv"])
def test_status_of_a_series_without_a_documented_status_is_refused(name):
    with pytest.raises(NotSupported, match="has no status, so"):
        Bench(model=name).drive.status()


def test_write_to_an_smv_first_checks_its_module():
    bench = Bench(model="lenze-smv")
    bench.drives[0].poke("P494", 130)
    with pytest.raises(WrongDriveError):
        bench.drive.write("P103", 50)
    assert not any(b"\x02" in data for data in bench.sent)
    assert bench.drives[0].peek("P103", 0.0) == 600


def test_facts_from_memory_are_unconfirmed():
    for name in ("lenze-82xx", "lenze-9200", "lenze-smv"):
        model = load_model("drivecomm_lecom", "lecom", name)
        for info in model.parameters.values():
            assert (info.sure == "unconfirmed") == ("from memory" in info.source), info
