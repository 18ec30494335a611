"""WEG drives on a virtual line: reads and writes, the reason of a NAK, and refused commands."""

from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.errors import (
    AddressError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    UsageError,
    WrongDriveError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Damaged, Framed, Framer, installed
from drivecomm.testing import Overheard
from drivecomm.virtual import VirtualLine, virtual_drive

WEG = installed["weg"]
CODEC = WEG.codec(WEG.options())
END, STATE = b"\x04", b"\x04A00702\x05"
NAK, ACK = b"A\x15", b"A\x06"


class Talk:
    """A virtual drive, its line and its master."""

    def __init__(self, model="cfw-08", **options):
        self.virtual = Overheard(virtual_drive("weg", 1, model=model))
        self.line = VirtualLine([self.virtual])
        self.sent = []
        self.bus = drivecomm.open_bus(self.line.port, trace=self._trace)
        self.drive = self.bus.drive("weg", 1, model=model, **options)

    def _trace(self, event):
        if event.what == "sent":
            self.sent.append(event.data)

    def answer(self, start, *told, delay_s=0.01):
        """Answer requests that start with these bytes with each reply in turn, then as usual; None is silence."""
        left = list(told)

        def between(heard, reply):
            if not heard.data.startswith(start) or not left:
                return reply
            data = left.pop(0)
            return None if data is None else type(reply)(data=data, delay_s=delay_s)

        self.virtual.between = between


@pytest.fixture
def talk():
    made = Talk()
    with made.bus:
        yield made


def told(code, value):
    return CODEC.encode(WEG.message({"kind": "data", "address": 1, "code": code, "value": value}, "reply"))


@pytest.mark.parametrize(
    ("model", "asked", "raw", "value"),
    [("cfw-08", b"\x04A01703\x05", 780, "7.80"), ("cfw-09", b"\x04A01803\x05", 78, "7.8")],
)
def test_current_has_the_scale_and_the_code_of_its_series(model, asked, raw, value):
    """CFW-08 manual p. 181, CFW-09 manual p. 307."""
    talk = Talk(model)
    with talk.bus:
        talk.answer(asked, told(asked[2:7].decode(), raw))
        reading = talk.drive.read("output_current")
        assert (str(reading.value), reading.unit) == (value, "A")
        assert talk.sent == [asked, END]


@pytest.mark.parametrize(("model", "value", "unit"), [("cfw-08", 6, "Hz"), ("cfw-09", 600, "rpm")])
def test_minimum_has_the_unit_of_its_series(model, value, unit):
    talk = Talk(model)
    with talk.bus:
        talk.drive.write("P133", value)
        assert talk.virtual.peek("P133", 0.0) == 600
        reading = talk.drive.read("P133")
        assert (reading.value, reading.unit) == (value, unit)


def test_every_exchange_ends_with_eot(talk):
    talk.drive.read("P003")
    talk.drive.write("P133", 6)
    with pytest.raises(RefusedError):
        talk.drive.read("P699")
    assert talk.sent[1::2] == [END] * (len(talk.sent) // 2)
    assert END not in talk.sent[::2]


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (22, "came damaged"),
        (24, "the motor runs"),
        (25, "no such variable"),
        (26, "outside its limits"),
        (27, "read-only"),
        (0, "cannot be read or written"),
        (28, "cannot be read or written"),
        (3, "cannot be read or written"),
    ],
)
def test_reason_of_a_nak_is_read_from_v02_once(talk, code, text):
    talk.virtual.poke("V02.low", code)
    talk.answer(b"\x04A\x02", NAK)
    with pytest.raises(RefusedError, match=text):
        talk.drive.write("P133", 6)
    assert talk.sent[-3:] == [END, STATE, END]
    assert sum(each.startswith(b"\x04A\x02") for each in talk.sent) == 1


def test_nak_without_a_readable_v02_is_a_refusal(talk):
    talk.answer(b"\x04A", NAK, None, None, None)
    with pytest.raises(RefusedError, match="cannot be read or written"):
        talk.drive.read("P003")


def test_nak_to_a_read_of_v02_reads_no_reason(talk):
    talk.answer(STATE, NAK)
    with pytest.raises(RefusedError):
        talk.drive.read("V02.low")
    assert talk.sent == [STATE, END]


def test_late_ack_does_not_confirm_another_write():
    talk = Talk(attempts=1)
    with talk.bus:
        talk.answer(b"\x04A\x0202733", ACK, delay_s=0.3)
        with pytest.raises(NoReplyError):
            talk.drive.write("P133", 6)
        talk.answer(b"\x04A\x0204713", None)
        with pytest.raises(NoReplyError):
            talk.drive.write("P313", 0)


@settings(max_examples=25, deadline=None)
@given(delay_s=st.floats(0.08, 0.6), nexts=st.lists(st.sampled_from(["P133", "P313", "V00"]), min_size=1))
def test_late_nak_is_not_taken_for_that_of_the_next_request(delay_s, nexts):
    talk = Talk(attempts=1)
    held = {"P133": 300, "P313": 1, "V00": 7}
    talk.virtual.between = lambda heard, reply: (
        type(reply)(data=reply.data, delay_s=delay_s) if heard.data.startswith(b"\x04A07799") else reply
    )
    with talk.bus:
        for parameter in nexts:
            with suppress(ReplyError, RefusedError):
                talk.drive.read("P699")
            with suppress(ReplyError):
                assert talk.drive.read(parameter).raw == held[parameter]


@pytest.mark.parametrize("model", ["cfw-08", "cfw-09"])
@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.start(reverse=True),
        lambda drive: drive.stop(),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        lambda drive: drive.set_reference(percent=20),
        lambda drive: drive.write("V03", 0x0303),
        lambda drive: drive.write("V04", 4096),
        lambda drive: drive.write("command_word", 1),
        lambda drive: drive.write("V03", 0),
    ],
)
def test_command_is_refused_unsent(model, command):
    """No page gives the position of the mask of V03."""
    talk = Talk(model)
    with talk.bus:
        with pytest.raises(NotSupported, match="monitoring only"):
            command(talk.drive)
        assert talk.sent == []


def test_status_is_refused_as_its_bits_are_unconfirmed(talk):
    with pytest.raises(NotSupported, match="has no status, so"):
        talk.drive.status()
    for bit in range(8, 16):
        assert talk.drive.model.parameters[f"V02.{bit}"].sure == "unconfirmed"


def test_error_code_and_logical_state_are_halves_of_v02(talk):
    talk.answer(STATE, told("00702", 0x031C), told("00702", 0x031C))
    assert talk.drive.read("V02.low").raw == 28
    assert talk.drive.read("V02.high").raw == 3


def test_series_is_identified_by_its_type():
    talk = Talk("cfw-08")
    with talk.bus:
        assert talk.drive.identify() == {"drive_type": "7 (CFW-08)"}
    talk = Talk("cfw-08")
    with talk.bus:
        talk.virtual.poke("V00", 8)
        with pytest.raises(WrongDriveError):
            talk.drive.write("P133", 6)
    assert talk.virtual.peek("P133", 0.0) == 300


@pytest.mark.parametrize("equipment", [9, 6, "7", True, None])
def test_invalid_equipment_option_is_refused(equipment):
    with pytest.raises(UsageError):
        WEG.options(equipment=equipment)


@pytest.mark.parametrize("parameter", ["003", "P3", "P700", "V100", "V2", "P0031", "p003", "V02.16", "P003.mid", ""])
def test_malformed_variable_is_refused_with_the_right_form(talk, parameter):
    with pytest.raises(ParameterAddressError, match="P000 to P699"):
        talk.drive.read(parameter)


@pytest.mark.parametrize("address", [0, 31])
def test_address_outside_its_range_is_refused(talk, address):
    with pytest.raises(AddressError):
        talk.bus.drive("weg", address)


def test_scan_finds_drives_of_both_series():
    drives = [virtual_drive("weg", 1), virtual_drive("weg", 2, model="cfw-09"), virtual_drive("weg", 30)]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        assert [each.address for each in bus.scan(["weg"], addresses=[1, 2, 3, 30]) if each.sound] == [1, 2, 30]


@pytest.mark.parametrize(
    ("data", "reply"),
    [
        (b"\x04A\x0202733=0258\x03\x05", NAK),
        (b"\x04B\x0202733=0258\x03\x05", None),
        (b"\x04A\x0202733:0258\x03\x03", None),
        (b"\x04A0170A\x05", None),
        (b"\x04A01899\x05", NAK),
        (
            b"\x04A00900\x05",
            b"A\x0200900=0007\x03" + bytes([0x30 ^ 0x30 ^ 0x39 ^ 0x30 ^ 0x30 ^ 0x3D ^ 0x37 ^ 0x30 ^ 0x03]),
        ),
        (b"\x04", None),
    ],
)
def test_drive_answers_as_documented(data, reply):
    """CFW-08 manual p. 144, 180: silence for a wrong structure, NAK for a wrong BCC and for unknown variables."""
    drive = virtual_drive("weg", 1)
    found = Framer(drive.codec, "request")
    finds = [each for each in found.feed(data) if isinstance(each, Framed | Damaged)]
    answers = [each.data for each in (drive.hear(find, 0.0) for find in finds) if each is not None]
    assert answers == ([] if reply is None else [reply])
    assert drive.peek("P133", 0.0) == 300


@pytest.mark.parametrize("name", ["cfw-08", "cfw-09"])
def test_watchdog_of_both_series_has_its_parameters(name):
    model = load_model("drivecomm_weg", "weg", name)
    assert (model.watchdog.time, model.watchdog.action, model.watchdog.off) == ("P314", "P313", 0)
    assert dict(model.watchdog.actions) == {"ramp": 0, "coast": 1, "hold": 2}


def test_facts_from_memory_are_unconfirmed():
    for name in ("cfw-08", "cfw-09"):
        for info in load_model("drivecomm_weg", "weg", name).parameters.values():
            assert (info.sure == "unconfirmed") == ("from memory" in info.source), info
