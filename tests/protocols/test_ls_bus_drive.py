"""A virtual LS drive and its master in virtual time: effects of commands, and lost, late or stale replies."""

from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.bus import policies, set_watchdog
from drivecomm.errors import (
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    StateError,
    ValueRefusedError,
)
from drivecomm.protocol import Framer, MotorCommand, VirtualReply, installed
from drivecomm.testing import InterceptedDrive
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_ls_bus.telegrams import CODEC

RUN, REVERSE, STOP = b"\x0501W00061000271\x04", b"\x0501W00061000473\x04", b"\x0501W00061000170\x04"
RESET, ENABLE = b"\x0501W00061000877\x04", b"\x0501W0004100016E\x04"
COMMANDS, REFERENCES = b"\x0501W0006", b"\x0501W0005"
ALL_STOP, ALL_ENABLE = b"\x05FFW0006100019B\x04", b"\x05FFW00041000199\x04"


class DriveBench:
    """A virtual drive, its line and its master."""

    def __init__(self, model="ig5a", address=1):
        self.virtual = InterceptedDrive(virtual_drive("ls-bus", address, model=model))
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive("ls-bus", address, model=model)

    @property
    def motor(self):
        self.virtual.motor.advance(self.line.time)
        return self.virtual.motor

    def sent(self, start):
        """Return the requests received so far that start with these bytes."""
        return [each.data for each in self.virtual.heard if each.data.startswith(start)]

    def answer(self, start, *replies):
        """Answer requests that start with these bytes with each reply in turn, then as usual; None is silence."""
        left = list(replies)

        def answered(heard, usual):
            if not left or not heard.data.startswith(start):
                return usual
            data = left.pop(0)
            return None if data is None else VirtualReply(data=data, delay_s=0.01)

        self.virtual.between = answered

    def say(self, data):
        """Return the reply of the drive to these bytes; None for silence."""
        find, *_ = Framer(CODEC, "request").feed(data)
        reply = self.virtual.hear(find, self.line.time)
        return reply.data if reply else None


@pytest.fixture
def talk():
    made = DriveBench()
    with made.bus:
        yield made


def summed(body):
    return body + b"%02X\x04" % (sum(body[1:]) & 0xFF)


def delayed(reply, delay_s):
    return VirtualReply(data=reply.data, delay_s=delay_s)


# Effects of commands on the motor


@pytest.mark.parametrize(("reverse", "command"), [(False, RUN), (True, REVERSE)])
def test_start_runs_the_motor_and_stop_stops_it(talk, reverse, command):
    talk.drive.set_reference(hz=20)
    talk.drive.start(reverse=reverse)
    talk.line.advance(30)
    assert talk.sent(COMMANDS) == [command]
    assert talk.motor.output_hz == (-20 if reverse else 20)
    status = talk.drive.status()
    assert (status.running, status.reverse, status.at_reference) == (True, reverse, True)
    assert talk.drive.read("output_frequency").value == 20
    talk.drive.stop()
    talk.line.advance(30)
    assert not talk.motor.running
    assert not talk.drive.status().running


def test_start_and_reference_are_preceded_by_a_write_enable(talk):
    assert talk.drive.read("0x0004").raw == 0
    talk.drive.set_reference(hz=20)
    talk.drive.start()
    assert talk.sent(b"\x0501W") == [ENABLE, summed(b"\x0501W0005107D0"), ENABLE, RUN]


def test_stop_is_sent_before_and_after_the_write_enable(talk):
    """The drive was started at its terminals and refuses writes."""
    talk.virtual.motor.run(20.0, talk.line.time)
    talk.line.advance(30)
    talk.drive.stop()
    assert talk.sent(b"\x0501W") == [STOP, ENABLE, STOP]
    talk.line.advance(30)
    assert not talk.motor.running


def test_operation_command_of_0_does_not_stop_the_motor(talk):
    talk.drive.set_reference(hz=20)
    talk.drive.start()
    talk.drive.write("operation_command", 0)
    talk.line.advance(30)
    assert talk.motor.output_hz == 20


def test_start_without_a_reply_is_sent_once(talk):
    talk.answer(RUN, *[None] * 9)
    with pytest.raises(NoReplyError, match="commanded to run"):
        talk.drive.start()
    assert talk.sent(RUN) == [RUN]


def test_stop_without_a_reply_is_sent_again(talk):
    talk.drive.start()
    talk.answer(STOP, *[None] * 9)
    with pytest.raises(NoReplyError):
        talk.drive.stop()
    assert len(talk.sent(STOP)) > 2
    assert talk.motor.command is not MotorCommand.RUN


def test_reset_is_sent_once_and_only_in_a_fault(talk):
    talk.drive.reset()
    assert talk.sent(COMMANDS) == []
    talk.virtual.trip(2, talk.line.time)
    status = talk.drive.status()
    assert (status.fault, status.fault_code, status.fault_text) == (True, 2, "OV overvoltage")
    with pytest.raises(StateError, match="reset it first"):
        talk.drive.start()
    talk.drive.reset()
    assert talk.sent(COMMANDS) == [RESET]
    assert not talk.drive.status().fault


def test_trip_word_with_two_bits_has_no_text_of_either(talk):
    talk.virtual.trip(3, talk.line.time)
    status = talk.drive.status()
    assert status.fault
    assert "OC" not in status.fault_text
    assert "OV" not in status.fault_text


# References


@pytest.mark.parametrize(("hz", "digits"), [(0, b"0000"), ("0.01", b"0001"), (400, b"9C40")])
def test_reference_at_its_limits_is_sent_in_hundredths_of_a_hertz(talk, hz, digits):
    talk.drive.set_reference(hz=hz)
    assert talk.sent(REFERENCES) == [summed(REFERENCES + b"1" + digits)]


@pytest.mark.parametrize("hz", [-1, "400.01", "0.005", 700])
def test_reference_that_does_not_fit_is_refused_unsent(talk, hz):
    with pytest.raises(ValueRefusedError):
        talk.drive.set_reference(hz=hz)
    assert talk.sent(b"\x0501W") == []


def test_reference_in_percent_is_refused_without_a_known_maximum(talk):
    with pytest.raises(NotSupported, match="hertz only"):
        talk.drive.set_reference(percent=20)


# Replies that carry little information


def test_write_reply_may_repeat_the_previous_value(talk):
    """SV-iG5A manual p. 11-5: the reply to the first write holds the previous data."""
    talk.answer(REFERENCES, summed(b"\x0601W0000"))
    talk.drive.set_reference(hz=20)
    assert talk.drive.read("0x0005").value == 20


def test_write_reply_is_rejected_as_the_reply_to_a_read(talk):
    talk.answer(b"\x0501R000A", *[summed(b"\x0601W07D0")] * 9)
    with pytest.raises(ReplyError):
        talk.drive.read("0x000A")


@pytest.mark.parametrize("words", [0, 2, 8])
def test_reply_with_another_number_of_words_is_rejected(talk, words):
    talk.answer(b"\x0501R000A", *[summed(b"\x0601R" + b"07D0" * words)] * 9)
    with pytest.raises(ReplyError):
        talk.drive.read("0x000A")


def test_next_request_waits_for_a_late_reply():
    virtual, events = InterceptedDrive(virtual_drive("ls-bus", 1)), []
    virtual.poke("0x0007", 123)
    virtual.between = lambda heard, usual: delayed(usual, 0.3 if heard.data[4:8] == b"0007" else 0.15)
    with drivecomm.open_bus(VirtualLine([virtual]).port, trace=events.append) as bus:
        drive = bus.drive("ls-bus", 1, model="ig5a", attempts=1)
        with pytest.raises(NoReplyError):
            drive.read("0x0007")
        assert drive.read("0x000C").raw == 0
    late = summed(b"\x0601R007B")
    assert [each.data == late for each in events] == [False, True, False, False]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    late_s=st.floats(0.15, 1.2),
    usual_s=st.sampled_from([0.01, 0.15]),
    nexts=st.lists(st.sampled_from(["0x0000", "0x0001", "0x0005"]), min_size=1),
)
def test_late_replies_never_give_a_wrong_value(late_s, usual_s, nexts):
    talk, held = DriveBench(), {"0x0000": 10, "0x0001": 11, "0x0005": 2500}
    with talk.bus:
        for parameter, raw in {**held, "0x0007": 123}.items():
            talk.virtual.poke(parameter, raw)
        drive = talk.bus.drive("ls-bus", 1, model="ig5a", attempts=1)
        talk.virtual.between = lambda heard, usual: delayed(usual, late_s if heard.data[4:8] == b"0007" else usual_s)
        for parameter in nexts:
            with suppress(ReplyError):
                assert drive.read("0x0007").raw == 123
            with suppress(ReplyError):
                assert drive.read(parameter).raw == held[parameter]


def test_station_number_is_sent_in_hexadecimal():
    talk = DriveBench(address=16)
    with talk.bus:
        assert talk.drive.read("0x0000").raw == 10
        assert talk.sent(b"\x0510R")
        assert not talk.sent(b"\x0516R")


def test_up_to_eight_neighbouring_registers_are_read_by_one_telegram(talk):
    talk.drive.read_many([f"0x{each:04X}" for each in range(4, 13)])
    assert [each[4:9] for each in talk.sent(b"\x0501R")] == [b"00048", b"000C1"]


# Refusals


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [("IF", 1, "no such command"), ("IA", 2, "no such address"), ("ID", 3, "out of its range"), ("WM", 20, "0x0004")],
)
def test_refusal_has_the_code_and_meaning_of_the_manual(talk, error, code, text):
    talk.answer(b"\x0501R000A", summed(b"\x1501R" + error.encode()))
    with pytest.raises(RefusedError, match=text) as refused:
        talk.drive.read("0x000A")
    assert refused.value.code == code
    assert refused.value.reason.startswith(error)
    assert len(talk.sent(b"\x0501R000A")) == 1


def test_fe_refusal_of_a_read_is_retried(talk):
    talk.answer(b"\x0501R000A", *[summed(b"\x1501RFE")] * 2)
    assert talk.drive.read("0x000A").raw == 0
    assert len(talk.sent(b"\x0501R000A")) == 3


def test_fe_refusal_of_a_start_is_not_retried(talk):
    talk.answer(RUN, *[summed(b"\x1501WFE")] * 9)
    with pytest.raises(ReplyError):
        talk.drive.start()
    assert talk.sent(RUN) == [RUN]


def test_request_with_a_wrong_sum_is_refused_with_fe(talk):
    assert talk.say(b"\x0501R30001A8\x04") == summed(b"\x1501RFE")


@pytest.mark.parametrize("body", [b"\x0501R300", b"\x0501R30001F", b"\x0501W000521388"])
def test_request_of_a_wrong_size_is_refused_with_fe(talk, body):
    assert talk.say(summed(body)) == summed(b"\x1501" + body[3:4] + b"FE")


def test_lower_case_command_is_refused_with_if(talk):
    assert talk.say(summed(b"\x0501r30001")) == summed(b"\x1501rIF")


@pytest.mark.parametrize("data", [b"\x0502R30001A7\x04", b"\x05FFW0006100019C\x04"])
def test_damaged_request_to_another_station_is_not_answered(talk, data):
    assert talk.say(data) is None


def test_disabled_write_and_invalid_address_or_value_are_refused(talk):
    assert talk.say(summed(b"\x0501W000510BB8")) == summed(b"\x1501WWM")
    talk.virtual.poke("0x0004", 1)
    assert talk.say(summed(b"\x0501W000510BB8")) == summed(b"\x0601W0BB8")
    assert talk.say(summed(b"\x0501W00051FFFF")) == summed(b"\x1501WID")
    assert talk.say(summed(b"\x0501W000A10001")) == summed(b"\x1501WWM")
    assert talk.say(summed(b"\x0501R30001")) == summed(b"\x1501RIA")


@pytest.mark.parametrize("address", ["5", "0x5", "5h", "0x00005", "0x000G", "frequency", "", "0X0005", "1x0005"])
def test_malformed_address_is_refused_with_the_right_form(talk, address):
    with pytest.raises(ParameterAddressError, match=r"0x000A|output_frequency|no parameter"):
        talk.drive.read(address)


def test_address_in_the_form_of_s100_manuals_is_accepted(talk):
    assert talk.drive.read("0h000a").parameter == talk.drive.read("0x000A").parameter == "0x000A"


# Commands X and Y


def test_y_reads_the_registers_of_x_until_a_power_cycle(talk):
    monitor = summed(b"\x0501Y")
    assert talk.say(monitor) == summed(b"\x1501YIA")
    talk.virtual.poke("0x0005", 35)
    assert talk.say(summed(b"\x0501X200000005")) == summed(b"\x0601X")
    assert talk.say(monitor) == summed(b"\x0601Y000A0023")
    talk.virtual.power_cycle(talk.line.time)
    assert talk.say(monitor) == summed(b"\x1501YIA")


def test_no_verb_sends_command_x_or_y(talk):
    for parameter in talk.drive.model.parameters:
        talk.drive.read(parameter)
    talk.drive.status()
    talk.drive.identify()
    assert not talk.sent(b"\x0501X")
    assert not talk.sent(b"\x0501Y")


# The whole line


def test_broadcast_stop_stops_both_drives():
    drives = [InterceptedDrive(virtual_drive("ls-bus", address)) for address in (1, 250)]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        for each in drives:
            drive = bus.drive("ls-bus", each.address, model="ig5a")
            drive.set_reference(hz=20)
            drive.start()
        bus.broadcast("ls-bus", model="ig5a").stop()
        line.advance(30)
        for each in drives:
            each.motor.advance(line.time)
            assert not each.motor.running
            assert [heard.data for heard in each.heard][-3:] == [ALL_STOP, ALL_ENABLE, ALL_STOP]


def test_scan_finds_stations_1_to_31():
    line = VirtualLine([virtual_drive("ls-bus", address) for address in (1, 2, 31)])
    with drivecomm.open_bus(line.port) as bus:
        assert [each.address for each in bus.scan(["ls-bus"])] == [1, 2, 31]


def test_watchdog_of_a_drive_without_one_cannot_be_set(talk):
    assert policies(talk.drive.model) == ()
    with pytest.raises(NotSupported, match="keypad"):
        set_watchdog(talk.drive, "ramp", 2)
    assert talk.sent(b"\x0501W") == []


@pytest.mark.parametrize("call", ["start", "stop", "reset"])
def test_s100_is_read_and_refuses_commands_and_writes(call):
    talk = DriveBench("s100")
    with talk.bus:
        with pytest.raises(NotSupported, match="monitoring only"):
            getattr(talk.drive, call)()
        with pytest.raises(NotSupported):
            talk.drive.write("operation_command", 1)
        with pytest.raises(NotSupported):
            talk.drive.set_reference(hz=20)
        assert talk.sent(b"\x0501W") == []
        assert talk.drive.read("0x0382").raw == 0


def test_start_without_a_model_is_refused():
    line = VirtualLine([virtual_drive("ls-bus", 1)])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(NotSupported, match="model"):
        bus.drive("ls-bus", 1).start()


def test_codec_and_plugin_agree_on_the_broadcast():
    plugin = installed["ls-bus"]
    message = CODEC.decode(ALL_STOP, "request")
    assert message.address == plugin.broadcast_address
    assert plugin.mismatch(message, CODEC.decode(summed(b"\x0601W0001"), "reply"))
