"""Virtual register drives: their behaviour beyond plain replies, on a line with its own clock."""

import pytest
from acme import MODE, SUM_ERROR, UNKNOWN, AcmeCodec, on_a_line, telegram

from drivecomm.errors import ParameterAddressError, RefusedError
from drivecomm.protocol import DriveState
from drivecomm.virtual import virtual_drive


def answer_to(line, data):
    line.transmit(data)
    return line.receive(line.time + 0.1, 100)


def test_damaged_request_is_refused_if_the_protocol_has_a_reply_for_it():
    with on_a_line(1) as (line, _, _, _):
        damaged = bytearray(telegram("read", 125))
        damaged[4] ^= 1
        reply = AcmeCodec().decode(answer_to(line, bytes(damaged)), "reply")
        assert (reply.kind, reply.register, reply.error) == ("refused", 125, SUM_ERROR)
        damaged[1] = 2
        assert answer_to(line, bytes(damaged)) == b""


def test_ramps_and_maximum_of_the_motor_follow_the_parameters():
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


def test_fault_memory_shifts_and_survives_a_power_cycle():
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


def test_watchdog_is_fed_by_telegrams_to_others_and_trips_in_silence():
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


def test_drive_that_is_not_set_up_refuses_commands():
    with on_a_line(1) as (line, _, _, drive):
        line.drives[0].poke("15", 0)
        with pytest.raises(RefusedError) as refused:
            drive.stop()
        assert refused.value.code == MODE


def test_power_cycle_clears_commands_and_keeps_stored_parameters():
    with on_a_line(1) as (line, _, _, drive):
        drive.write("ramp_up", 9, store=True)
        drive.start()
        line.drives[0].power_cycle(line.time)
        assert line.drives[0].peek("ramp_up", line.time) == 90
        assert not drive.status().running
        assert line.drives[0]._machine.words["120"] == 0


def test_unknown_register_is_refused_with_the_code_of_the_dialect():
    with on_a_line(1) as (line, _, _, _):
        reply = AcmeCodec().decode(answer_to(line, telegram("read", 201)), "reply")
        assert (reply.kind, reply.error) == ("refused", UNKNOWN)


def test_restarting_drive_ignores_requests_for_a_second():
    with on_a_line(1) as (line, _, _, _):
        line.transmit(telegram("write", 121, 0x9696))
        assert answer_to(line, telegram("read", 125)) == b""
        line.advance(1)
        assert answer_to(line, telegram("read", 125)) != b""


def test_peek_at_an_unknown_parameter_is_refused():
    with on_a_line(1) as (line, _, _, _), pytest.raises(ParameterAddressError, match="holds no parameter '99'"):
        line.drives[0].peek("99", line.time)


def test_poke_refuses_a_number_too_large_for_a_coil():
    drive = virtual_drive("modbus", 1)
    with pytest.raises(ParameterAddressError):
        drive.poke("c65500", 1)
    with pytest.raises(ValueError, match="has no room for 5"):
        drive.poke("c65", 5)


@pytest.mark.parametrize(("parameter", "raw"), [("ramp_up", 65536), ("trim", -65537), ("last_fault", 256)])
def test_poke_refuses_a_number_outside_the_range_of_a_register(parameter, raw):
    with on_a_line(1) as (line, _, _, _):
        with pytest.raises(ValueError, match=f"{parameter} has no room for {raw}"):
            line.drives[0].poke(parameter, raw)
        line.drives[0].poke("trim", -5)
        assert line.drives[0].peek("trim", line.time) == 0xFFFB


def test_broadcast_is_obeyed_and_not_answered():
    with on_a_line(1) as (line, _, _, drive):
        drive.start()
        assert answer_to(line, telegram("write", 120, 0, address=0)) == b""
        line.advance(5)
        assert drive.status().state is DriveState.READY


def test_only_drives_whose_watchdog_counts_foreign_telegrams_overhear():
    """A virtual plant passes telegrams to other drives only to drives that have `overhear`."""
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
