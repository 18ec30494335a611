"""Virtual drives that hold registers: what they do beside answering, on a line with a clock of its own."""

import pytest
from acme import MODE, SUM_ERROR, UNKNOWN, AcmeCodec, on_a_line, telegram

from drivecomm.errors import ParameterAddressError, RefusedError
from drivecomm.protocol import DriveState
from drivecomm.virtual import virtual_drive


def answer_to(line, data):
    line.transmit(data)
    return line.receive(line.time + 0.1, 100)


def test_a_damaged_request_is_answered_where_the_protocol_says_so():
    with on_a_line(1) as (line, _, _, _):
        damaged = bytearray(telegram("read", 125))
        damaged[4] ^= 1
        reply = AcmeCodec().decode(answer_to(line, bytes(damaged)), "reply")
        assert (reply.kind, reply.register, reply.error) == ("refused", 125, SUM_ERROR)
        damaged[1] = 2
        assert answer_to(line, bytes(damaged)) == b""


def test_the_ramps_and_the_limit_of_a_motor_are_those_of_its_parameters():
    with on_a_line(1) as (line, _, _, drive):
        motor = line.drives[0].motor
        assert (motor.ramp_up_s, motor.ramp_down_s, motor.maximum_hz) == (2, 4, 60)
        drive.write("ramp_up", 10, store=True)
        drive.start()
        line.advance(2)
        assert drive.read("output_frequency").value == pytest.approx(10, abs=1)
        motor.ramp_up_s = 1.0
        line.advance(2)
        assert drive.read("output_frequency").value == 25


def test_faults_shift_in_the_memory_and_stay_without_mains():
    with on_a_line(1) as (line, _, _, drive):
        virtual = line.drives[0]
        for code in (5, 6, 7, 8):
            virtual.trip(code, line.time)
            assert drive.status().fault_code == code
            drive.reset()
        held = [virtual.peek(each, line.time) for each in ("last_fault", "second_fault", "third_fault")]
        assert held == [8, 7, 6]
        virtual.power_cycle(line.time)
        assert virtual.peek("second_fault", line.time) == 7
        assert drive.status().state is DriveState.READY


def test_a_watchdog_trips_and_any_telegram_feeds_it_where_the_protocol_says_so():
    with on_a_line(1, 2) as (line, _, _, drive, other):
        line.drives[0].poke("14", 20)
        drive.start()
        for _ in range(5):
            line.advance(1.5)
            other.read("125")
        assert drive.status().running
        line.advance(2.5)
        status = drive.status()
        assert (status.fault_code, status.fault_text) == (33, "the master was silent")


def test_commands_are_refused_by_a_drive_that_is_not_set_up():
    with on_a_line(1) as (line, _, _, drive):
        line.drives[0].poke("15", 0)
        with pytest.raises(RefusedError) as refused:
            drive.stop()
        assert refused.value.code == MODE


def test_commands_are_forgotten_without_mains_and_stored_parameters_are_not():
    with on_a_line(1) as (line, _, _, drive):
        drive.write("ramp_up", 9, store=True)
        drive.start()
        line.drives[0].power_cycle(line.time)
        assert line.drives[0].peek("ramp_up", line.time) == 90
        assert not drive.status().running
        assert line.drives[0]._machine.words["120"] == 0


def test_what_a_dialect_does_not_know_is_refused_by_its_code():
    with on_a_line(1) as (line, _, _, _):
        reply = AcmeCodec().decode(answer_to(line, telegram("read", 201)), "reply")
        assert (reply.kind, reply.error) == ("refused", UNKNOWN)


def test_a_drive_that_starts_anew_is_deaf_for_a_while():
    with on_a_line(1) as (line, _, _, _):
        line.transmit(telegram("write", 121, 0x9696))
        assert answer_to(line, telegram("read", 125)) == b""
        line.advance(1)
        assert answer_to(line, telegram("read", 125)) != b""


def test_nobody_can_look_for_what_a_drive_does_not_hold():
    with on_a_line(1) as (line, _, _, _), pytest.raises(ParameterAddressError, match="holds no parameter '99'"):
        line.drives[0].peek("99", line.time)


def test_a_coil_holds_no_number_that_it_could_not_tell():
    drive = virtual_drive("modbus", 1)
    with pytest.raises(ParameterAddressError):
        drive.poke("c65500", 1)
    with pytest.raises(ValueError, match="has no room for 5"):
        drive.poke("c65", 5)


@pytest.mark.parametrize(("parameter", "raw"), [("ramp_up", 65536), ("trim", -65537), ("last_fault", 256)])
def test_a_register_holds_no_number_that_it_could_not_tell(parameter, raw):
    with on_a_line(1) as (line, _, _, _):
        with pytest.raises(ValueError, match=f"{parameter} has no room for {raw}"):
            line.drives[0].poke(parameter, raw)
        line.drives[0].poke("trim", -5)
        assert line.drives[0].peek("trim", line.time) == 0xFFFB


def test_what_is_for_all_drives_is_obeyed_and_not_answered():
    with on_a_line(1) as (line, _, _, drive):
        drive.start()
        assert answer_to(line, telegram("write", 120, 0, address=0)) == b""
        line.advance(5)
        assert drive.status().state is DriveState.READY


def test_a_drive_in_a_plant_is_told_of_telegrams_to_others_only_where_they_feed_its_watchdog():
    """A plant leaves the telegrams to others away from its drives, but for those that overhear."""
    with on_a_line(1) as (line, _, _, drive):
        virtual = line.drives[0]
        virtual.poke("14", 20)
        drive.start()
        assert hasattr(virtual, "overhear")
        for _ in range(3):
            line.advance(1.5)
            virtual.overhear(line.time)
        assert drive.status().running
    assert not hasattr(virtual_drive("modbus", 1), "overhear")
