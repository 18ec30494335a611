"""Eurotherm and Parker drives over EI Bisynch: both check characters, EE after a refusal, and that nothing moves."""

import pytest

import drivecomm
from drivecomm.errors import NotSupported, ParameterAddressError, RefusedError, TelegramError, UnexpectedReplyError
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

PLAIN, LIFTED = b"\x02ab5.\x03\x1b", b"\x02ab5.\x03\x3b"


class Answers:
    """Replaces the next answers of a drive."""

    def __init__(self, *data):
        self.left = list(data)

    def request(self, data, now):  # noqa: ARG002 - as a disturbance is called
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
def test_check_character_below_20h_is_taken_by_the_option_lift(lift, good):
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
def test_value_of_no_type_is_refused(data):
    with pytest.raises(TelegramError):
        drivecomm.encode("ei-bisynch", {"kind": "value", "mnemonic": "ab", "data": data}, direction="reply")


def test_refusal_says_what_ee_holds(bench):
    with pytest.raises(RefusedError, match="invalid mnemonic") as error:
        bench.drive.read("zz")
    assert error.value.code == 0x01C7
    assert bench.sent == [b"\x040011zz\x05", b"\x040011EE\x05"]


def test_request_that_came_damaged_is_sent_again(bench):
    bench.line.disturbances.append(Answers(b"\x04", b"\x02EE>02C2\x03\x4e"))
    assert bench.drive.read("09").value == 40
    assert bench.sent == [b"\x04001109\x05", b"\x040011EE\x05", b"\x04001109\x05"]


def test_value_in_another_format_is_not_believed(bench):
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
def test_nothing_that_moves_a_motor_is_sent(bench, command):
    with pytest.raises(NotSupported, match="monitoring only"):
        command(bench.drive)
    assert not bench.sent


def test_mnemonic_has_two_characters(bench):
    with pytest.raises(ParameterAddressError):
        bench.drive.read("130")
