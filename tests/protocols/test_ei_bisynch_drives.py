"""Eurotherm and Parker drives over EI Bisynch: both check characters, EE after a refusal, and refused commands."""

from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.errors import (
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    TelegramError,
    UnexpectedReplyError,
)
from drivecomm.models import load_model, model_names
from drivecomm.protocol import VirtualReply, installed
from drivecomm.testing import Overheard
from drivecomm.virtual import VirtualLine, virtual_drive

PLAIN, LIFTED = b"\x02ab5.\x03\x1b", b"\x02ab5.\x03\x3b"


class Answers:
    """Replacements for the next replies of a drive."""

    def __init__(self, *data):
        self.left = list(data)

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(0.0, self.left.pop(0) if self.left else data)]


@pytest.fixture
def bench():
    class Bench:
        line = VirtualLine([virtual_drive("ei-bisynch", 1)])
        sent = []  # noqa: RUF012
        bus = drivecomm.open_bus(line.port, trace=lambda event: event.what == "sent" and Bench.sent.append(event.data))
        drive = bus.drive("ei-bisynch", 1, model="parker-590plus")

    return Bench


@pytest.mark.parametrize(("lift", "good"), [(None, (PLAIN, LIFTED)), (True, (LIFTED,)), (False, (PLAIN,))])
def test_option_lift_selects_the_form_of_a_check_character_below_20h(lift, good):
    plugin = installed["ei-bisynch"]
    codec = plugin.codec(plugin.options(lift=lift))
    for data in (PLAIN, LIFTED):
        if data in good:
            assert codec.encode(codec.decode(data, "reply")) == good[0]
        else:
            with pytest.raises(TelegramError) as error:
                codec.decode(data, "reply")
            assert error.value.category == "checksum"


@pytest.mark.parametrize("data", ["1500", ">", ">12345", ">1f", "1.23456", "123456.", ".5", "+1."])
def test_value_that_fits_no_type_is_refused(data):
    with pytest.raises(TelegramError):
        drivecomm.encode("ei-bisynch", {"kind": "value", "mnemonic": "ab", "data": data}, direction="reply")


def test_refusal_has_the_code_and_text_of_ee(bench):
    with pytest.raises(RefusedError, match="invalid mnemonic") as error:
        bench.drive.read("zz")
    assert error.value.code == 0x01C7
    assert bench.sent == [b"\x040011zz\x05", b"\x040011EE\x05"]


def test_request_that_arrived_damaged_is_resent(bench):
    bench.line.disturbances.append(Answers(b"\x04", b"\x02EE>02C2\x03\x4e"))
    assert bench.drive.read("09").value == 40
    assert bench.sent == [b"\x04001109\x05", b"\x040011EE\x05", b"\x04001109\x05"]


def test_value_in_another_format_is_an_unexpected_reply(bench):
    with pytest.raises(UnexpectedReplyError, match="read it as u16"):
        bench.drive.read("0F", type="s32")


@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.stop(),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        *[lambda drive, name=name: drive.write(name, 1) for name in ("ow", "!1", "!3", "EE", "remote_sequence")],
    ],
)
def test_command_is_refused_unsent(bench, command):
    with pytest.raises(NotSupported, match="monitoring only"):
        command(bench.drive)
    assert not bench.sent


def test_mnemonic_without_two_characters_is_refused(bench):
    with pytest.raises(ParameterAddressError):
        bench.drive.read("130")


def test_request_that_always_arrives_damaged_is_sent_three_times(bench):
    bench.line.disturbances.append(Answers(*[b"\x04", b"\x02EE>03C2\x03\x4f"] * 9))
    with pytest.raises(RefusedError, match="framing error or overrun") as error:
        bench.drive.read("09")
    assert error.value.code == 0x03C2
    assert bench.sent == [b"\x04001109\x05", b"\x040011EE\x05"] * 3


@pytest.mark.parametrize("tells", [b"", b"\x04", b"\x02EE12.\x03\x1c", b"\x02EE>02C2\x03\x4f"])
def test_refusal_without_a_readable_ee_is_raised_with_its_own_code(bench, tells):
    bench.line.disturbances.append(Answers(b"\x04", *[tells] * 9))
    with pytest.raises(RefusedError, match="EE was not read") as error:
        bench.drive.read("09")
    assert error.value.code == 0x04


class Spoilt(Answers):
    """Damage to the check characters of the next writes."""

    def request(self, data, now):  # noqa: ARG002
        return [(0.0, data[:-1] + self.left.pop(0) if self.left and b"\x02" in data else data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(0.0, data)]


def test_ee_holds_the_error_of_a_damaged_write_until_it_is_cleared():
    virtual = virtual_drive("ei-bisynch", 1)
    line = VirtualLine([virtual])
    line.disturbances.append(Spoilt(*[b"?"] * 3))
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("ei-bisynch", 1)
        with pytest.raises(RefusedError, match="wrong check character"):
            drive.write("EE", 0, type="u16")
        assert not line.disturbances[-1].left
        assert drive.read("EE").raw == virtual.peek("EE", line.time) == 0x02C2
        drive.write("EE", 0, type="u16")
        assert drive.read("EE").raw == 0x00C0


def test_write_to_a_read_only_parameter_is_refused_with_the_code_of_ee():
    line = VirtualLine([virtual_drive("ei-bisynch", 1)])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(RefusedError, match="it can only be read") as error:
        bus.drive("ei-bisynch", 1).write("0F", 1, type="u16")
    assert error.value.code == 0x05C8


def test_drive_in_another_group_does_not_answer():
    line = VirtualLine([virtual_drive("ei-bisynch", 16)])
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive("ei-bisynch", 16).read("II").raw == 0x0590
        with pytest.raises(NoReplyError):
            bus.drive("ei-bisynch", 1).read("II")


def test_value_of_nine_digits_is_read_exactly(bench):
    """590+ manual p. A-12: up to five digits before the point and four after it."""
    bench.line.disturbances.append(Answers(b"\x02ab-12345.6789\x03\x32"))
    assert str(bench.drive.read("ab").value) == "-12345.6789"


def delayed(reply, delay_s):
    return None if reply is None else VirtualReply(data=reply.data, delay_s=delay_s)


def test_late_acknowledgement_does_not_confirm_a_write_to_another_drive():
    late, other = (Overheard(virtual_drive("ei-bisynch", address)) for address in (1, 2))
    late.between = lambda _heard, usual: delayed(usual, 0.4)
    other.between = lambda _heard, usual: delayed(usual, 0.2)
    with drivecomm.open_bus(VirtualLine([late, other]).port) as bus:
        with pytest.raises(NoReplyError):
            bus.drive("ei-bisynch", 1, attempts=1).write("EE", 0, type="u16")
        with pytest.raises(RefusedError):
            bus.drive("ei-bisynch", 2, attempts=1).write("0F", 1, type="u16")


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    late_s=st.floats(0.25, 1.5),
    usual_s=st.sampled_from([0.01, 0.2]),
    nexts=st.lists(st.sampled_from([(1, "0F"), (2, "09"), (2, "0F")]), min_size=1),
)
def test_late_replies_never_give_a_wrong_value(late_s, usual_s, nexts):
    first, second = (Overheard(virtual_drive("ei-bisynch", address)) for address in (1, 2))
    first.poke("09", 1234)
    held = {(1, "0F"): 512, (2, "09"): 400000, (2, "0F"): 3}
    second.poke("0F", 3)
    first.between = lambda heard, usual: delayed(usual, late_s if heard.data[5:7] == b"09" else usual_s)
    with drivecomm.open_bus(VirtualLine([first, second]).port) as bus:
        drives = {each: bus.drive("ei-bisynch", each, model="parker-590plus", attempts=1) for each in (1, 2)}
        for address, parameter in nexts:
            with suppress(ReplyError):
                assert drives[1].read("09").raw == 1234
            with suppress(ReplyError):
                assert drives[address].read(parameter).raw == held[address, parameter]


@pytest.mark.parametrize("address", range(160))
def test_address_is_sent_as_group_and_unit_digits_each_twice(address):
    plugin = installed["ei-bisynch"]
    group, unit = divmod(address, 16)
    line = VirtualLine([virtual_drive("ei-bisynch", address)])
    sent = []
    with drivecomm.open_bus(line.port, trace=lambda event: event.what == "sent" and sent.append(event.data)) as bus:
        bus.drive("ei-bisynch", address).read("II")
    assert sent == [b"\x04%d%d%X%XII\x05" % (group, group, unit, unit)]
    assert address in plugin.addresses


def test_facts_from_memory_are_unconfirmed():
    plugin = installed["ei-bisynch"]
    for name in model_names(plugin.package, plugin.name):
        for info in load_model(plugin.package, plugin.name, name).parameters.values():
            assert "memory" not in info.source or info.sure == "unconfirmed", f"{name}: {info.address}"
