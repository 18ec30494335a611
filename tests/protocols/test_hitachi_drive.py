"""A virtual Hitachi drive and its master in virtual time: effects of commands, and lost or late replies."""

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
from drivecomm.protocol import MotorCommand, Stop
from drivecomm.testing import InterceptedDrive
from drivecomm.virtual import VirtualLine, virtual_drive

RUN, STOP, ALL_STOP = b"\x020100130\r", b"\x020100031\r", b"\x02FF00030\r"


class DriveBench:
    """A virtual drive, its line and its master."""

    def __init__(self, model="sj700"):
        self.virtual = InterceptedDrive(virtual_drive("hitachi", 1, model=model))
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive("hitachi", 1, model=model)

    @property
    def motor(self):
        self.virtual.motor.advance(self.line.time)
        return self.virtual.motor

    def sent(self, start):
        """Return the requests received so far that start with these bytes."""
        return [each.data for each in self.virtual.heard if each.data.startswith(start)]

    def lose(self, start):
        """Drop the replies to requests that start with these bytes."""
        self.virtual.between = lambda heard, reply: None if heard.data.startswith(start) else reply


@pytest.fixture
def talk():
    made = DriveBench()
    with made.bus:
        yield made


@pytest.mark.parametrize("model", ["sj300", "sj700", "l300p"])
@pytest.mark.parametrize("reverse", [False, True])
def test_start_runs_the_motor_and_stop_stops_it(model, reverse):
    talk = DriveBench(model)
    with talk.bus:
        talk.drive.set_reference(hz=20)
        talk.drive.start(reverse=reverse)
        talk.line.advance(30)
        assert talk.motor.output_hz == (-20 if reverse else 20)
        status = talk.drive.status()
        assert status.running
        assert status.reverse is reverse
        assert status.at_reference
        assert talk.drive.read("03-1").value == 20
        talk.drive.stop()
        talk.line.advance(30)
        assert not talk.motor.running
        assert not talk.drive.status().running


def test_coast_sets_frs_and_the_next_start_clears_it(talk):
    talk.drive.set_reference(hz=20)
    talk.drive.start()
    talk.drive.stop(Stop.COAST)
    assert talk.motor.command is MotorCommand.OFF
    assert talk.sent(b"\x020102")[-1] == b"\x0201020000000000000800" + b"0B\r"
    talk.drive.start()
    assert talk.motor.running
    assert talk.sent(b"\x020102")[-1][5:21] == b"0" * 16


def test_start_without_a_reply_is_sent_once(talk):
    talk.lose(RUN)
    with pytest.raises(NoReplyError, match="commanded to run"):
        talk.drive.start()
    assert talk.sent(RUN) == [RUN]


def test_stop_without_a_reply_is_sent_again(talk):
    talk.drive.start()
    talk.lose(STOP)
    with pytest.raises(NoReplyError):
        talk.drive.stop()
    assert len(talk.sent(STOP)) == 3
    assert not talk.motor.running or talk.motor.command is MotorCommand.RAMP_STOP


def test_start_is_refused_unsent_if_a002_selects_another_source(talk):
    talk.virtual.poke("A002", 1)
    with pytest.raises(StateError, match="run_command_source"):
        talk.drive.start()
    assert talk.sent(b"\x020100") == []


def test_reference_is_refused_unsent_if_a001_selects_another_source(talk):
    talk.virtual.poke("A001", 2)
    with pytest.raises(StateError, match="frequency_source"):
        talk.drive.set_reference(hz=10)
    assert talk.sent(b"\x020101") == []


@pytest.mark.parametrize("hz", [0, "0.01", 400])
def test_reference_is_sent_in_hundredths_of_a_hertz(talk, hz):
    talk.drive.set_reference(hz=hz)
    assert talk.sent(b"\x020101")[0][5:11] == b"%06d" % round(float(hz) * 100)


@pytest.mark.parametrize("hz", [-1, "400.01", 1005, "0.005"])
def test_reference_that_does_not_fit_is_refused_unsent(talk, hz):
    """Values from 100000 would be the feedback of a PID controller (3G3RX-V1 manual I578-E1, p. 8-79)."""
    with pytest.raises(ValueRefusedError):
        talk.drive.set_reference(hz=hz)
    assert talk.sent(b"\x020101") == []


def test_reference_in_percent_is_not_supported(talk):
    with pytest.raises(NotSupported):
        talk.drive.set_reference(percent=50)


def test_reset_clears_the_run_command_and_pulses_rs(talk):
    talk.drive.start()
    talk.virtual.trip(7, talk.line.time)
    status = talk.drive.status()
    assert status.fault
    assert status.fault_code == 7
    assert "E07" in status.fault_text
    talk.drive.reset()
    images = [each[5:21] for each in talk.sent(b"\x020102")]
    assert images[-2:] == [b"0000000000040000", b"0" * 16]
    order = [each.data for each in talk.virtual.heard]
    assert order.index(STOP) < order.index(talk.sent(b"\x0201020000000000040000")[0])
    talk.line.advance(5)
    assert not talk.motor.running
    assert not talk.drive.status().fault


def test_reset_without_a_fault_sends_no_command(talk):
    talk.drive.start()
    heard = len(talk.virtual.heard)
    talk.drive.reset()
    assert {each.message.kind for each in talk.virtual.heard[heard:]} <= {"status", "monitor"}
    assert talk.motor.running


def test_status_08_is_a_trip_of_sj300_and_a_retry_of_l300p():
    """SJ300 manual, p. B-10; L300P manual, p. 4-67; V3000 manual, p. 154."""
    for model, fault in (("sj300", True), ("l300p", False)):
        talk = DriveBench(model)
        with talk.bus:
            codec = talk.virtual.codec
            said = codec.encode(drivecomm.protocol.installed["hitachi"].message(
                {"kind": "data", "node": 1, "data": "08000100"}, "reply"
            ))  # fmt: skip
            talk.virtual.between = lambda heard, reply, said=said: (
                type(reply)(data=said, delay_s=0.01) if heard.message.kind == "status" else reply
            )
            assert talk.drive.status().fault is fault


def test_stored_write_checks_and_then_sends_the_store_command(talk):
    talk.drive.write("F002", 12, store=True)
    kinds = [each.message.kind for each in talk.virtual.heard]
    assert kinds[-3:] == ["write", "check", "store"]
    talk.virtual.power_cycle(talk.line.time)
    assert talk.drive.read("F002").value == 12


def test_volatile_write_is_lost_in_a_power_cycle(talk):
    talk.drive.write("F002", 12)
    assert [each.message.kind for each in talk.virtual.heard][-1] == "write"
    talk.virtual.power_cycle(talk.line.time)
    assert talk.drive.read("F002").value == 10


def test_stored_write_is_refused_while_the_drive_cannot_store(talk):
    talk.virtual.poke("09", 0)
    with pytest.raises(RefusedError, match="RAM only"):
        talk.drive.write("F002", 12, store=True)
    assert talk.sent(b"\x02010A") == []


def test_monitored_values_are_read_by_one_telegram(talk):
    readings = talk.drive.read_many(["03-1", "03-2", "03-13", "04-A", "04-B"])
    assert [each.message.kind for each in talk.virtual.heard] == ["monitor", "status"]
    assert all(readings)


def test_parameter_beyond_16_bits_is_written_and_read(talk):
    talk.drive.write("F002", 3600)
    assert talk.sent(b"\x020107")[-1][9:17] == b"00360000"
    assert talk.drive.read("F002").raw == 360000


@pytest.mark.parametrize("address", ["d001", "A1", "03-14", "05-7-1", "05-1-10", "13", "", "A0001"])
def test_malformed_address_is_refused(talk, address):
    with pytest.raises(ParameterAddressError):
        talk.drive.read(address)


def test_terminal_image_is_written_once_and_cannot_be_read(talk):
    talk.drive.write("02", 1 << 38)
    assert talk.sent(b"\x020102")[-1][5:21] == b"0000004000000000"
    with pytest.raises(NotSupported):
        talk.drive.read("02")
    talk.lose(b"\x020102")
    with pytest.raises(ReplyError):
        talk.drive.write("02", 1)
    assert len(talk.sent(b"\x0201020000000000000001")) == 1


def test_late_reply_to_another_parameter_is_ignored():
    talk = DriveBench()
    with talk.bus:
        drive = talk.bus.drive("hitachi", 1, model="sj700", attempts=1)
        talk.virtual.between = lambda heard, reply: (
            type(reply)(data=reply.data, delay_s=0.6) if heard.data.startswith(b"\x020106F002") else reply
        )
        with pytest.raises(NoReplyError):
            drive.read("F002")
        assert drive.read("A001").raw == 3
        assert drive.read("04-A").raw == 2


@settings(max_examples=25, deadline=None)
@given(delay_s=st.floats(0.25, 1.3), nexts=st.lists(st.sampled_from(["A001", "C078", "04-A"]), min_size=1))
def test_late_replies_never_give_a_wrong_value(delay_s, nexts):
    talk = DriveBench()
    held = {"A001": 3, "C078": 0, "04-A": 2}
    with talk.bus:
        drive = talk.bus.drive("hitachi", 1, model="sj700", attempts=1)
        talk.virtual.between = lambda heard, reply: (
            type(reply)(data=reply.data, delay_s=delay_s) if heard.data.startswith(b"\x020106F002") else reply
        )
        for parameter in nexts:
            with suppress(ReplyError):
                assert drive.read("F002").raw == 1000
            with suppress(ReplyError):
                assert drive.read(parameter).raw == held[parameter]


def test_broadcast_stop_is_one_telegram_and_stops_both_drives():
    drives = [virtual_drive("hitachi", address, model="sj300") for address in (1, 2)]
    line, sent = VirtualLine(drives), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        for address in (1, 2):
            bus.drive("hitachi", address, model="sj300").start()
        del sent[:]
        bus.broadcast("hitachi").stop()
    assert [each.data for each in sent if each.what == "sent"] == [ALL_STOP]
    line.advance(60)
    for each in drives:
        each.follow(line.time)
        assert not each.motor.running


def test_drive_without_a_model_can_be_stopped(talk):
    talk.drive.start()
    with drivecomm.open_bus(talk.line.port) as bus:
        bus.drive("hitachi", 1).stop()
    assert talk.motor.command is not MotorCommand.RUN


def test_scan_finds_drives_at_neighbouring_addresses():
    line = VirtualLine([virtual_drive("hitachi", address) for address in (1, 2, 3)])
    with drivecomm.open_bus(line.port) as bus:
        found = list(bus.scan(["hitachi"], addresses=range(1, 5)))
    assert [each.address for each in found] == [1, 2, 3]


@pytest.mark.parametrize(("policy", "fault"), [("trip", 41), ("ramp", 0), ("coast", 0)])
def test_watchdog_carries_out_its_policy_in_silence(talk, policy, fault):
    """SJ700-2 manual, p. 4-129."""
    set_watchdog(talk.drive, policy, 2.0)
    talk.drive.set_reference(hz=10)
    talk.drive.start()
    talk.line.advance(1.0)
    assert talk.motor.running
    talk.line.advance(30)
    talk.virtual.follow(talk.line.time)
    assert not talk.motor.running
    assert talk.motor.fault == fault


def test_drive_without_a_documented_watchdog_offers_hold_at_most():
    talk = DriveBench("sj300")
    with talk.bus:
        assert set(policies(talk.drive.model)) <= {"hold"}
        assert "not documented" in talk.drive.capabilities.link_loss


def test_request_that_arrived_damaged_is_resent_unless_a_start(talk):
    misheard, asked = b"\x0201\x1502" + b"16\r", b"\x020106A001" + b"77\r"
    told = []

    def once(heard, reply):
        told.append(heard.data)
        is_first = heard.data in (asked, RUN) and told.count(heard.data) == 1
        return type(reply)(data=misheard, delay_s=0.01) if is_first else reply

    talk.virtual.between = once
    assert talk.drive.read("A001").raw == 3
    assert told.count(asked) == 2
    with pytest.raises((RefusedError, ReplyError)):
        talk.drive.start()
    assert told.count(RUN) == 1
