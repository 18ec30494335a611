"""A virtual Toshiba drive and its master in virtual time: effects of commands, and lost or late replies."""

from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.bus import policies
from drivecomm.errors import (
    AddressError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    ValueRefusedError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Damaged, Framed, Framer, MotorCommand, Stop, installed
from drivecomm.testing import InterceptedDrive
from drivecomm.virtual import VirtualLine, virtual_drive

PLUGIN = installed["toshiba"]
CODEC = PLUGIN.codec(PLUGIN.options())
RUN, STOP = b"(01PFA00C400&BD)\r", b"(01PFA00C000&B9)\r"


class DriveBench:
    """A virtual drive, its line and its master."""

    def __init__(self, model="vf-s11", **options):
        self.virtual = InterceptedDrive(virtual_drive("toshiba", 1, model=model))
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive("toshiba", 1, model=model, **options)

    @property
    def motor(self):
        self.virtual.motor.advance(self.line.time)
        return self.virtual.motor

    @property
    def heard(self):
        return [each.data for each in self.virtual.heard]

    def lose(self, start):
        """Drop the replies to requests that start with these bytes."""
        self.virtual.between = lambda heard, reply: None if heard.data.startswith(start) else reply


@pytest.fixture
def talk():
    made = DriveBench()
    with made.bus:
        yield made


def answers(data, *addresses):
    """Return the replies of drives with these numbers, by number."""
    found = Framer(CODEC, "request").feed(data)
    replies = {}
    for address in addresses:
        drive = virtual_drive("toshiba", address)
        told = [drive.hear(each, 0.0) for each in found if isinstance(each, Framed | Damaged)]
        replies[address] = [each.data for each in told if each is not None]
    return replies


@pytest.mark.parametrize("reverse", [False, True])
def test_start_runs_the_motor_and_stop_stops_it(talk, reverse):
    talk.drive.set_reference(hz=20)
    talk.drive.start(reverse=reverse)
    talk.line.advance(30)
    assert talk.motor.output_hz == (-20 if reverse else 20)
    status = talk.drive.status()
    assert (status.running, status.reverse, status.fault) == (True, reverse, False)
    assert talk.drive.read("output_frequency").value == 20
    talk.drive.stop()
    talk.line.advance(30)
    assert not talk.motor.running
    assert not talk.drive.status().running


def test_every_command_keeps_the_bus_control_bits_set(talk):
    """Without bits 14 and 15 of FA00 the panel or the terminals have control."""
    talk.drive.start()
    talk.drive.stop()
    talk.drive.stop(Stop.COAST)
    talk.virtual.trip(3, talk.line.time)
    talk.drive.reset()
    words = [int(each[8:12], 16) for each in talk.heard if each.startswith(b"(01PFA00")]
    assert len(words) >= 5
    assert all(word & 0xC000 == 0xC000 for word in words)


def test_commands_and_references_never_go_to_eeprom(talk):
    talk.drive.set_reference(hz=20)
    talk.drive.start()
    talk.drive.stop()
    talk.drive.write("0012", 45)
    talk.drive.write("FA01", 10)
    assert not any(each.startswith(b"(01W") for each in talk.heard)


def test_stored_write_uses_w_and_survives_a_power_cycle(talk):
    talk.drive.write("0012", 40, store=True)
    assert talk.heard[-1] == b"(01W00120FA0&B0)\r"
    talk.drive.write("0012", 30)
    talk.virtual.power_cycle(talk.line.time)
    assert talk.drive.read("0012").value == 40


def test_stored_write_of_a_command_is_refused(talk):
    with pytest.raises(NotSupported):
        talk.drive.write("FA01", 10, store=True)


def test_write_without_a_model_goes_to_ram():
    talk = DriveBench()
    with talk.bus:
        talk.bus.drive("toshiba", 1).write("0012", 4500)
        assert talk.heard[-1].startswith(b"(01P0012")


def test_start_without_a_reply_is_sent_once(talk):
    talk.lose(RUN)
    with pytest.raises(NoReplyError, match="commanded to run"):
        talk.drive.start()
    assert talk.heard.count(RUN) == 1


def test_start_that_is_not_obeyed_is_taken_back(talk):
    codec = talk.virtual.codec
    stands = codec.encode(
        PLUGIN.message({"number": 1, "command": "R", "communication_number": 0xFD01, "data": 0}, "reply")
    )
    talk.virtual.between = lambda heard, reply: (
        type(reply)(data=stands, delay_s=0.01) if heard.data.startswith(b"(01RFD01") else reply
    )
    with pytest.raises(drivecomm.DriveCommError):
        talk.drive.start()
    assert STOP in talk.heard[talk.heard.index(RUN) :]
    assert talk.motor.command is not MotorCommand.RUN


def test_stop_without_a_reply_is_sent_again(talk):
    talk.drive.start()
    talk.lose(STOP)
    with pytest.raises(NoReplyError):
        talk.drive.stop()
    assert talk.heard.count(STOP) == 3
    assert talk.motor.command is not MotorCommand.RUN


def test_first_stop_is_followed_by_one_read_and_resent(talk):
    """The reply to a write equals the write, so an echo could confirm it."""
    talk.drive.stop()
    assert talk.heard == [STOP, b"(01RFD00&EB)\r", STOP]


def test_first_write_is_preceded_by_a_read_that_proves_the_drive(talk):
    talk.drive.write("0012", 45)
    assert talk.heard[0] == b"(01RFD00&EB)\r"
    talk.drive.write("0012", 46)
    assert talk.heard[2:] == [b"(01P001211F8&A2)\r"]


@pytest.mark.parametrize("hz", [0, "0.01", 60])
def test_reference_is_sent_in_hundredths_of_a_hertz(talk, hz):
    talk.drive.set_reference(hz=hz)
    assert talk.heard[-1].startswith(b"(01PFA01%04X" % round(float(hz) * 100))


@pytest.mark.parametrize("hz", [-1, "60.01", "0.005"])
def test_reference_that_does_not_fit_is_refused_unsent(talk, hz):
    with pytest.raises(ValueRefusedError):
        talk.drive.set_reference(hz=hz)
    assert not any(each.startswith(b"(01PFA01") for each in talk.heard)


def test_reference_in_percent_refers_to_the_upper_limit(talk):
    talk.drive.write("0012", 40)
    talk.drive.set_reference(percent=25)
    assert talk.heard[-1].startswith(b"(01PFA0103E8")


def test_trip_is_recognised_by_the_lower_case_of_a_reply(talk):
    talk.virtual.trip(5, talk.line.time)
    status = talk.drive.status()
    assert (status.fault, status.fault_code, status.running) == (True, 5, False)
    assert talk.drive.read("FD01.tripped").raw == 1
    assert talk.drive.read("0012").value == 60
    talk.drive.reset()
    assert not talk.drive.status().fault
    assert not talk.motor.running


def test_lower_case_reply_confirms_a_write(talk):
    talk.virtual.trip(5, talk.line.time)
    talk.drive.write("0012", 45)
    assert talk.virtual.peek("0012", talk.line.time) == 4500


def test_refusal_has_its_reason(talk):
    with pytest.raises(RefusedError, match="no such communication number"):
        talk.drive.write("1234", 1)


@pytest.mark.parametrize("parameter", ["FD00", "FD01.tripped", "FE03"])
def test_write_to_a_read_only_number_is_refused(talk, parameter):
    with pytest.raises((NotSupported, RefusedError)):
        talk.drive.write(parameter, 1)


def test_read_of_a_busy_drive_is_retried(talk):
    left = [b"(01N0000&BD)\r"] * 3
    talk.virtual.between = lambda heard, reply: (
        type(reply)(data=left.pop(), delay_s=0.01) if left and heard.data.startswith(b"(01R0012") else reply
    )
    assert talk.drive.read("0012").value == 60
    assert talk.heard.count(b"(01R0012&C4)\r") == 4


def test_request_that_arrived_damaged_is_resent_unless_a_start(talk):
    told = []

    def once(heard, reply):
        told.append(heard.data)
        is_first = heard.data in (b"(01R0012&C4)\r", RUN) and told.count(heard.data) == 1
        return type(reply)(data=b"(01N0004&C1)\r", delay_s=0.01) if is_first else reply

    talk.virtual.between = once
    assert talk.drive.read("0012").value == 60
    with pytest.raises((RefusedError, ReplyError)):
        talk.drive.start()
    assert told.count(RUN) == 1


@pytest.mark.parametrize(
    "parameter", ["FD0", "fd00", "FD000", "", "FD00.3", "F82G", "0x12", "0012.tripped", "FD00.tripped"]
)
def test_malformed_communication_number_is_refused(talk, parameter):
    with pytest.raises(ParameterAddressError, match="four hexadecimal digits"):
        talk.drive.read(parameter)


def test_parameter_may_be_named_as_on_the_panel():
    """F829 has the communication number 0829 (VF-S15 manual E6581913 p. 5)."""
    talk = DriveBench("vf-s15")
    with talk.bus:
        assert talk.drive.read("F829").text == "Toshiba"
        assert talk.heard == [b"(01R0829&D4)\r"]


@settings(max_examples=25, deadline=None)
@given(delay_s=st.floats(0.08, 0.6), nexts=st.lists(st.sampled_from(["1234", "FD01", "FE70"]), min_size=1))
def test_late_refusal_is_not_taken_for_that_of_the_next_request(delay_s, nexts):
    """A refusal names no number, so a late one could match the next request."""
    talk = DriveBench(attempts=1)
    talk.virtual.between = lambda heard, reply: (
        type(reply)(data=reply.data, delay_s=delay_s) if heard.data.startswith(b"(01R1234") else reply
    )
    with talk.bus:
        for parameter in nexts:
            with suppress(ReplyError, RefusedError):
                talk.drive.read("1234")
            if parameter != "1234":
                with suppress(ReplyError):
                    assert talk.drive.read(parameter).raw == 0


def test_broadcast_stop_stops_all_drives_even_if_drive_00_answers():
    drives = [virtual_drive("toshiba", address) for address in (0, 1, 42)]
    line, sent = VirtualLine(drives), []

    class Answering:
        """A disturbance by drive 00, which answers `**` as VF-AS1 manual E6581315 p. 11 says for binary telegrams."""

        def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
            return [(0.0, data)]

        def reply(self, data, drive, now):  # noqa: ARG002
            return [(0.0, data)]

    line.disturbances.append(Answering())
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        for drive in drives:
            bus.drive("toshiba", drive.address, model="vf-s11").start()
        del sent[:]
        bus.broadcast("toshiba", model="vf-s11").stop()
    assert [each.data for each in sent if each.what == "sent"] == [b"(**PFA00C000&AC)\r"]
    line.advance(60)
    for each in drives:
        each.follow(line.time)
        assert not each.motor.running


@pytest.mark.parametrize(
    ("data", "answered_by"), [(b"(*2R0012&BF)\r", [2]), (b"(1*R0012&BE)\r", [10]), (b"(**R0012&B7)\r", [])]
)
def test_wild_card_request_is_answered_by_the_smallest_number_only(data, answered_by):
    told = answers(data, 0, 2, 10, 12, 22)
    assert [address for address, replies in told.items() if replies] == answered_by


def test_wild_card_write_is_obeyed_by_all_matching_drives():
    found = Framer(CODEC, "request").feed(b"(*2P00120FA0&A4)\r")
    drives = [virtual_drive("toshiba", address) for address in (2, 12, 13)]
    for drive in drives:
        drive.hear(found[0], 0.0)
    assert [drive.peek("0012", 0.0) for drive in drives] == [4000, 4000, 6000]


def test_reply_has_a_number_only_if_the_request_had_one():
    assert answers(b"(R0012&63)\r", 7) == {7: [b"(R00121770&32)\r"]}
    assert answers(b"(07R0012&CA)\r", 7) == {7: [b"(07R00121770&99)\r"]}


def test_binary_request_is_answered_in_binary():
    assert answers(bytes.fromhex("2F 07 52 00 12 9A"), 7) == {7: [bytes.fromhex("2F 07 52 00 12 17 70 21")]}


@pytest.mark.parametrize(
    ("data", "reply"),
    [
        (b"(01R0012&00)\r", b"(01N0004&C1)\r"),
        (b"(R0012&00)\r", b"(N0004&60)\r"),
        (bytes.fromhex("2F 58 02 05 C4 00 17 70 D8"), bytes.fromhex("2F 4E 00 04 81")),
        (bytes.fromhex("2F 01 52 00 12 00"), bytes.fromhex("2F 01 4E 00 04 82")),
        (b"(02R0012&00)\r", None),
        (b"(01R001G&D9)\r", None),
        (b"(1R0012&94)\r", None),
    ],
)
def test_wrong_sum_is_refused_and_other_damage_is_not_answered(data, reply):
    """VF-AS1 manual E6581315 p. 16 and 20."""
    assert answers(data, 1) == {1: [] if reply is None else [reply]}


def test_block_write_is_refused():
    found = Framer(CODEC, "request").feed(bytes.fromhex("2F 58 02 05 C4 00 17 70 D9"))
    drive = virtual_drive("toshiba", 1)
    told = drive.hear(found[0], 0.0)
    assert CODEC.decode(told.data, "reply").error_code == 0
    assert not drive.motor.running


def test_scan_finds_number_00_and_others():
    line = VirtualLine([virtual_drive("toshiba", address) for address in (0, 1, 99)])
    with drivecomm.open_bus(line.port) as bus:
        assert [each.address for each in bus.scan(["toshiba"], addresses=[0, 1, 2, 99])] == [0, 1, 99]


def test_number_above_99_is_refused():
    with DriveBench().bus as bus, pytest.raises(AddressError):
        bus.drive("toshiba", 100)


@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.stop(),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        lambda drive: drive.write("FA00", 0xC400),
        lambda drive: drive.write("FA01", 20),
    ],
)
def test_command_to_a_vf_s15_is_refused_unsent(command):
    talk = DriveBench("vf-s15")
    with talk.bus:
        with pytest.raises(NotSupported, match="monitoring only"):
            command(talk.drive)
        assert talk.heard == []


def test_vf_s15_has_no_status_but_shows_a_trip():
    talk = DriveBench("vf-s15")
    with talk.bus:
        with pytest.raises(NotSupported, match="has no status, so"):
            talk.drive.status()
        assert talk.drive.read("FD00.tripped").raw == 0
        talk.virtual.between = lambda _heard, reply: type(reply)(data=b"(01rFD001770&DA)\r", delay_s=0.01)
        readings = talk.drive.read_many(["FD00", "FD00.tripped"])
        assert [each.raw for each in readings] == [6000, 1]


@pytest.mark.parametrize("name", ["vf-s11", "vf-s15"])
def test_link_loss_names_the_keypad_parameter(name):
    model = load_model("drivecomm_toshiba", "toshiba", name)
    assert "F804" in model.link_loss
    assert set(policies(model)) <= {"hold"}


def test_facts_behind_commands_are_confirmed_by_programs():
    """No page prints the bits of FA00; they come from programs that drive such drives."""
    model = load_model("drivecomm_toshiba", "toshiba", "vf-s11")
    assert {model.parameters[each].sure for each in ("FA00", "FA01", "FD01")} == {"field"}
