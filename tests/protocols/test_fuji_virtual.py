"""The virtual Fuji inverter on a virtual line."""

from __future__ import annotations

from decimal import Decimal

import pytest

import drivecomm
from drivecomm import (
    DriveCommError,
    DriveState,
    NoReplyError,
    ParameterAddressError,
    RefusedError,
    StateError,
    Stop,
    ValueRefusedError,
)
from drivecomm.plant import FaultPlan
from drivecomm.protocol import Framed, Framer, Noise
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_fuji import protocol
from drivecomm_fuji.options import FujiOptions

RESET = b"\x0101\x05E        \x03"
MODELS = ("frenic", "g11s", "e11s", "vg")


def line_of(*drives, **more):
    line = VirtualLine(drives, **more)
    return line, drivecomm.open_bus(line.port)


def meet(model="frenic", **options):
    """Return a virtual inverter, its line, and the drive object of its master."""
    inverter = virtual_drive("fuji", 1, model=model, **options)
    line, bus = line_of(inverter)
    return inverter, line, bus.drive("fuji", 1, model=model, **options)


def frame(text: bytes) -> bytes:
    total = sum(text[1:]) % 256
    return text + f"{total:02X}".encode()


def heard(inverter, data: bytes, now=0.0) -> list[bytes]:
    """Return the replies of an inverter to these bytes."""
    framer = Framer(inverter.codec, "request")
    finds = [find for find in [*framer.feed(data), *framer.flush()] if not isinstance(find, Noise)]
    return [reply.data for reply in (inverter.hear(find, now) for find in finds) if reply is not None]


# Every function


@pytest.mark.soak
@pytest.mark.parametrize("short", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_readable_functions_are_read_as_the_inverter_holds_them(model, short):
    inverter = virtual_drive("fuji", 1, model=model)
    line, bus = line_of(inverter)
    drive = bus.drive("fuji", 1, model=model, short_frames=short)
    for address, info in drive.model.parameters.items():
        if "r" in info.access:
            assert drive.read(address).raw == inverter.peek(address, line.time), address
        else:
            with pytest.raises(RefusedError) as caught:
                drive.read(address)
            assert caught.value.code == 78


@pytest.mark.parametrize("model", MODELS)
def test_each_function_accepts_its_own_value_as_a_write(model):
    inverter, line, drive = meet(model)
    for address, info in drive.model.parameters.items():
        if "w" in info.access and info.type != "[19]":
            reading = drive.read(address) if "r" in info.access else None
            again = reading.value if reading else 0
            if info.type == "[12]" and not again:
                continue
            drive.write(address, again, store=address[0] != "S")
            assert reading is None or inverter.peek(address, line.time) == reading.raw


def test_write_outside_the_limits_is_refused_with_code_80():
    _, _, drive = meet()
    plain = drive._bus.drive("fuji", 1)
    for parameter, value in (("H30", 4), ("S08", 36001), ("C05", 40001), ("S07", 32)):
        with pytest.raises(RefusedError) as caught:
            plain.write(parameter, value, store=parameter[0] != "S")
        assert caught.value.code == 80
    assert plain.read("M26").value == 80
    assert drive.read("M26").text == "data out of range"


def test_write_of_a_word_outside_its_format_is_refused_with_code_80():
    _, _, drive = meet()
    with pytest.raises(RefusedError) as caught:
        drive._bus.drive("fuji", 1).write("F07", 0x7000, store=True)
    assert caught.value.code == 80


def test_unknown_function_is_refused_with_code_78():
    _, _, drive = meet()
    for verb in (lambda: drive.read("F99"), lambda: drive.write("F99", 1, store=True)):
        with pytest.raises(RefusedError) as caught:
            verb()
        assert caught.value.code == 78


def test_function_outside_the_generation_is_refused_with_code_78():
    inverter, _, drive = meet("e11s", number_check=False)
    with pytest.raises(RefusedError) as caught:
        drive.read("F47")
    assert caught.value.code == 78
    assert heard(inverter, frame(b"\x0101\x05Ro05 0000\x03")) == [frame(b"\x0101\x15Ro05 004E\x03")]


def test_write_to_a_read_only_function_is_refused_with_code_79():
    inverter, _, _ = meet()
    assert heard(inverter, frame(b"\x0101\x05WM09 0001\x03")) == [frame(b"\x0101\x15WM09   4F\x03")]


def test_some_functions_are_not_written_while_running():
    _, line, drive = meet()
    drive.set_reference(hz=30)
    drive.start()
    line.advance(1.0)
    with pytest.raises(RefusedError) as caught:
        drive.write("P01", 2, store=True)
    assert caught.value.code == 79
    drive.write("C05", "10.00", store=True)
    drive.stop()
    line.advance(20.0)
    drive.write("P01", 2, store=True)
    assert drive.read("P01").value == 2


def test_only_the_addressed_inverter_answers():
    first, second = virtual_drive("fuji", 1), virtual_drive("fuji", 31)
    line, bus = line_of(first, second)
    second.poke("C05", 4711)
    assert bus.drive("fuji", 31).read("C05").value == 4711
    assert bus.drive("fuji", 1).read("C05").value == 500
    with pytest.raises(NoReplyError):
        bus.drive("fuji", 2).read("C05")
    assert [found.address for found in bus.scan(["fuji"])] == [1, 31]
    assert line.time > 0


def test_poked_values_are_read_and_unknown_functions_are_refused():
    inverter, line, drive = meet()
    inverter.poke("F18", -20)
    assert inverter.peek("F18", line.time) == 0xFFEC
    assert drive.read("bias_frequency").value == -20
    inverter.poke("M35", -6000)
    assert drive.read("M35").value == Decimal("-60.00")
    inverter.poke("F18", "5")
    assert drive.read("F18").value == 5
    for parameter in ("F99", "nothing", ""):
        with pytest.raises(ParameterAddressError):
            inverter.peek(parameter, line.time)
        with pytest.raises(ParameterAddressError):
            inverter.poke(parameter, 1)


# Running


@pytest.mark.parametrize("short", [False, True])
@pytest.mark.parametrize("model", ["frenic", "g11s", "e11s"])
def test_motor_ramps_up_reverses_and_stops(model, short):
    inverter, line, drive = meet(model)
    drive = drive._bus.drive("fuji", 1, model=model, short_frames=short)
    assert drive.status().state is DriveState.READY
    drive.set_reference(hz=30)
    drive.start()
    line.advance(1.0)
    status = drive.status()
    assert (status.state, status.reverse) == (DriveState.RUNNING, False)
    assert "ACC" in status.flags
    assert 0 < drive.read("M06").value < 12000
    line.advance(10.0)
    assert drive.read("M09").value == Decimal("30.00")
    assert drive.read("M06").value == 12000
    assert drive.read("M05").value == Decimal("30.00")
    assert drive.read("M13").value == 1
    assert drive.read("M12").value > 100
    assert not {"ACC", "DEC"} & set(drive.status().flags)
    drive.start(reverse=True)
    line.advance(1.0)
    assert "DEC" in drive.status().flags
    line.advance(20.0)
    assert drive.status().reverse
    assert drive.read("M06").value == -12000
    assert drive.read("M01").value == -12000
    assert drive.read("M09").value == (Decimal("30.00") if short else Decimal("-30.00"))
    drive.stop()
    line.advance(0.5)
    assert {"REV", "DEC"} <= set(drive.status().flags)
    line.advance(20.0)
    assert drive.status().state is DriveState.READY
    assert not inverter.motor.running


def test_vector_inverter_reports_the_frequency_without_a_sign():
    _, line, drive = meet("vg", maximum_frequency_hz=50)
    drive.set_reference(hz=25)
    drive.start(reverse=True)
    line.advance(20.0)
    assert drive.read("M09").value == Decimal("25.00")
    assert drive.read("M06").value == -10000
    assert drive.status().reverse


def test_output_frequency_is_limited_to_the_maximum_frequency():
    _, line, drive = meet()
    with pytest.raises(ValueRefusedError, match=r"above 50\.0 Hz, the maximum frequency of fuji:1"):
        drive.set_reference(hz=400)
    drive.write("S05", 400)
    drive.start()
    line.advance(20.0)
    assert drive.read("M09").value == Decimal("50.00")
    assert drive.read("S05").value == Decimal("400.00")


def test_s01_overrides_s05():
    _, line, drive = meet()
    drive.write("S05", 10)
    drive.write("S01", 16000)
    drive.start()
    line.advance(20.0)
    assert drive.read("M09").value == Decimal("40.00")
    drive.set_reference(percent=0)
    line.advance(20.0)
    assert drive.read("M09").value == 0
    drive.set_reference(percent=-50)
    line.advance(20.0)
    assert drive.read("M09").value == Decimal("-25.00")


def test_set_reference_replaces_the_reference_of_another_master():
    inverter, line, drive = meet()
    drive.set_reference(hz=10)
    drive.start()
    for foreign in (16000, 0):
        heard(inverter, frame(b"\x0101\x05WS01 %04X\x03" % foreign), line.time)
        heard(inverter, frame(b"\x0101\x05WS05 0FA0\x03"), line.time)
        drive.set_reference(hz=10)
        line.advance(20.0)
        assert drive.read("M09").value == Decimal("10.00")


def test_terminal_write_does_not_undo_the_stop_of_another_master():
    inverter, line, drive = meet()
    drive.set_reference(hz=30)
    drive.start()
    line.advance(20.0)
    heard(inverter, frame(b"\x0101\x05WS06 0000\x03"), line.time)
    with pytest.raises(StateError, match="start or stop it from here first"):
        drive.call("terminals", X1=True)
    line.advance(20.0)
    drive.call("terminals", X1=True)
    line.advance(20.0)
    assert not inverter.motor.running


def test_ramp_time_of_s08_is_used():
    _, line, drive = meet()
    drive.write("S08", 50)
    drive.set_reference(hz=50)
    drive.start()
    line.advance(25.0)
    assert 20 < drive.read("M09").value < 30


def test_motor_coasts_by_its_terminal_and_starts_again():
    inverter, line, drive = meet(coast_terminal="X3")
    drive.set_reference(hz=30)
    drive.start()
    line.advance(20.0)
    drive.stop(Stop.COAST)
    assert drive.read("M13").text == "X3"
    assert inverter.motor.output_hz == 0
    assert inverter.motor.shaft_hz > 0
    drive.start()
    line.advance(20.0)
    assert drive.read("M09").value == Decimal("30.00")


def test_run_command_with_both_directions_stops_the_motor():
    inverter, line, drive = meet()
    drive.set_reference(hz=30)
    drive.start()
    line.advance(20.0)
    assert heard(inverter, frame(b"\x0101\x05WS06 0003\x03"), line.time) == [frame(b"\x0101\x06WS06 0000\x03")]
    line.advance(20.0)
    assert drive.status().state is DriveState.READY


def test_unknown_bit_of_s06_is_refused_with_code_80():
    inverter, _, _ = meet("e11s")
    assert heard(inverter, frame(b"\x0101\x05WS06 0080\x03")) == [frame(b"\x0101\x15WS06 0050\x03")]


@pytest.mark.parametrize(
    ("link", "frequency", "run"), [(0, False, False), (1, True, False), (2, False, True), (3, True, True)]
)
def test_link_function_h30_decides_which_writes_are_allowed(link, frequency, run):
    inverter, _, drive = meet()
    inverter.poke("H30", link)
    for parameter, allowed in (("S05", frequency), ("S01", frequency), ("S06", run)):
        if allowed:
            drive.write(parameter, 0)
        else:
            with pytest.raises(RefusedError) as caught:
                drive.write(parameter, 0)
            assert caught.value.code == 76
    assert drive.status().remote == (link != 0)


def test_e11s_ignores_references_and_commands_that_h30_forbids():
    inverter, line, drive = meet("e11s")
    inverter.poke("H30", 1)
    drive.set_reference(hz=30)
    drive.start()
    line.advance(10.0)
    assert drive.status().state is DriveState.READY
    inverter.poke("H30", 2)
    inverter.machine.local_hz = 20.0
    line.advance(10.0)
    assert drive.read("M09").value == 0
    line.advance(10.0)
    assert drive.read("M09").value == Decimal("20.00")


# Alarms


@pytest.mark.parametrize("model", MODELS)
def test_trip_stores_the_values_measured_before_it(model):
    inverter, line, drive = meet(model, maximum_frequency_hz=50)
    drive.set_reference(hz=30)
    drive.start()
    line.advance(20.0)
    before = drive.read("M06").value, drive.read("M11").value
    assert before[0] == 12000
    inverter.motor.trip(3, line.time)
    assert (drive.read("M32").value, drive.read("M37").value) == before
    assert (drive.read("M06").value, drive.read("M11").value, drive.read("M16").raw) == (0, 0, 3)


def test_poked_measured_value_is_overwritten():
    inverter, line, drive = meet()
    inverter.poke("M09", 1234)
    assert drive.read("M09").value == inverter.peek("M09", line.time) == 0


@pytest.mark.parametrize("model", MODELS)
def test_alarm_is_logged_and_cleared_by_each_kind_of_reset(model):
    inverter, line, drive = meet(model, maximum_frequency_hz=50)
    drive.set_reference(hz=30)
    drive.start(reverse=True)
    line.advance(20.0)
    inverter.trip(3, line.time)
    status = drive.status()
    assert (status.state, status.fault_code, status.running) == (DriveState.FAULT, 3, False)
    assert status.fault_text == "OC3 overcurrent, constant speed"
    assert abs(drive.read("M35").value) == 30
    assert drive.read("M32").value == -12000
    with pytest.raises(StateError, match="reset it first"):
        drive.start()
    drive.reset()
    line.advance(1.0)
    assert drive.status().state is DriveState.READY
    inverter.trip(10, line.time)
    assert "NUV" not in drive.status().flags
    drive.call("reset_by_command", command="m")
    inverter.motor.trip(7, line.time)
    assert drive.status().fault_code == 7
    drive.call("reset_by_command", command="E")
    assert [drive.read(f"M{number}").value for number in (16, 17, 18, 19)] == [7, 10, 3, 0]
    assert drive.status().state is DriveState.READY


def test_reset_under_a_run_command_starts_the_motor():
    inverter, line, drive = meet()
    drive.set_reference(hz=30)
    drive.start()
    line.advance(10.0)
    inverter.trip(3, line.time)
    assert heard(inverter, frame(RESET), line.time) != []
    line.advance(10.0)
    assert drive.read("M09").value == Decimal("30.00")


def test_reset_needs_a_rising_edge():
    inverter, line, _ = meet()
    reset = frame(b"\x0101\x05WS06 8000\x03")
    heard(inverter, reset)
    inverter.trip(3, line.time)
    heard(inverter, reset)
    assert inverter.motor.fault == 3
    heard(inverter, frame(b"\x0101\x05WS06 0000\x03"))
    heard(inverter, reset)
    assert inverter.motor.fault == 0


# Refusals (section 2.6)


@pytest.mark.parametrize(
    ("request_", "answer", "code"),
    [
        (b"\x0101\x06WS05 0000\x03", b"\x0101\x15WS05   4A\x03", 74),
        (b"\x0101\x05WS05 0000\x0d", b"\x0101\x15WS05   4A\x03", 74),
        (b"\x0101\x05WS05-0000\x03", b"\x0101\x15WS05   4A\x03", 74),
        (b"\x0101\x05QS05 0000\x03", b"\x0101\x15RS05   4B\x03", 75),
        (b"\x0101\x05wS05 0000\x03", b"\x0101\x15RS05   4B\x03", 75),
        (b"\x0101\x05RQ05 0000\x03", b"\x0101\x15RQ05   4E\x03", 78),
        (b"\x0101\x05WS05 00g0\x03", b"\x0101\x15WS05   50\x03", 80),
        (b"\x0101\x05f0001\x0d", b"\x0101\x15f\x03", 74),
        (b"\x0101\x05f000g\x03", b"\x0101\x15f\x03", 80),
        (b"\x0101\x05m0001\x03", b"\x0101\x15m\x03", 80),
        (b"\x0101\x05b0001\x03", b"\x0101\x15b\x03", 75),
        (b"\x0101\x05k\x0d", b"\x0101\x15k0000\x03", 74),
        (b"\x0101\x05i\x03", b"\x0101\x15i0000\x03", 75),
    ],
)
def test_malformed_request_is_refused_with_the_code_of_its_fault(request_, answer, code):
    inverter, _, _ = meet()
    assert heard(inverter, frame(request_)) == [frame(answer)]
    assert inverter.peek("M26", 0.0) == code


@pytest.mark.parametrize("request_", [b"\x0101\x05n0001\x03", b"\x0101\x05n\x03"])
def test_unknown_short_command_gets_a_standard_refusal(request_):
    inverter, _, _ = meet()
    (answer,) = heard(inverter, frame(request_))
    assert (len(answer), answer[3:5], answer[11:13]) == (16, b"\x15R", b"4B")
    assert inverter.codec.measure(request_[:5], "request") in (6, 8)
    assert inverter.codec.measure(b"\x0101\x15n", "reply") == 16


def test_e11s_refuses_command_a():
    inverter, _, _ = meet("e11s")
    assert heard(inverter, frame(b"\x0101\x05AS05 0000\x03")) == [frame(b"\x0101\x15AS05 004B\x03")]


def test_request_with_a_wrong_checksum_is_not_answered():
    inverter, line, drive = meet()
    assert heard(inverter, b"\x0101\x05RM09 0000\x0350") == []
    assert inverter.peek("M26", 0.0) == 71
    inverter.poke("M26", 0)
    assert heard(inverter, b"\x0102\x05RM09 0000\x0300") == []
    assert heard(inverter, b"\x0101\x05RM09") == []
    assert heard(inverter, frame(b"\x0102\x06k1021\x03")) == []
    assert inverter.peek("M26", 0.0) == 0
    assert drive.read("M26").value == 0
    assert line.time > 0


def test_e11s_repeats_the_written_value_in_its_reply():
    inverter, _, _ = meet("e11s")
    assert heard(inverter, frame(b"\x0101\x05WS05 0BB8\x03")) == [frame(b"\x0101\x06WS05 0BB8\x03")]


# High-speed writes


def test_high_speed_write_makes_the_inverter_busy_for_a_while():
    inverter, line, drive = meet(high_speed_writes=True)
    drive.write("F15", 60, store=True)
    drive.write("C05", "7.00", store=True)
    assert "BUSY" in drive.status().flags
    assert inverter.peek("F15", line.time) == 60
    assert inverter.peek("C05", line.time) == 700
    assert inverter.peek("M26", line.time) == 81
    line.advance(1.0)
    assert "BUSY" not in drive.status().flags


def test_vector_inverter_treats_command_a_as_w():
    inverter, line, drive = meet("vg", high_speed_writes=True)
    before = line.time
    drive.write("F15", 60, store=True)
    assert line.time - before > 0.1
    assert "BUSY" not in drive.status().flags
    assert inverter.peek("F15", line.time) == 60


# Slow writes


def test_initialising_by_h03_restores_the_start_values():
    inverter, line, drive = meet()
    drive.write("F15", 60, store=True)
    drive.write("P01", 2, store=True)
    drive.write("H03", 2, store=True)
    assert (inverter.peek("P01", line.time), inverter.peek("F15", line.time)) == (4, 60)
    before = line.time
    drive.write("H03", 1, store=True)
    assert line.time - before > 5
    assert (inverter.peek("F15", line.time), inverter.peek("H03", line.time)) == (70, 0)
    drive.write("H03", 0, store=True)


def test_tuning_is_acknowledged_when_it_is_finished():
    inverter, line, drive = meet()
    before = line.time
    drive.write("P04", 0x0101, store=True)
    assert line.time - before > 10
    assert inverter.peek("P04", line.time) == 0


def test_response_interval_delays_the_reply():
    _, line, drive = meet(response_interval_s=0.4)
    drive.read("M09")
    assert 0.4 < line.time < 0.6


# All stations


def test_broadcast_reference_run_and_stop_reach_all_stations():
    drives = [virtual_drive("fuji", address) for address in (1, 7, 31)]
    line, bus = line_of(*drives)
    everybody = bus.broadcast("fuji", model="frenic")
    everybody.write("S05", 30)
    everybody.write("S06", 1)
    line.advance(20.0)
    assert [drive.peek("M09", line.time) for drive in drives] == [3000] * 3
    everybody.stop()
    line.advance(20.0)
    assert [drive.peek("M09", line.time) for drive in drives] == [0] * 3
    assert bus.drive("fuji", 7).read("S05").value == 3000


@pytest.mark.parametrize(
    "request_",
    [
        b"\x0199\x05RM09 0000\x03",
        b"\x0199\x05AS05 0BB8\x03",
        b"\x0199\x05WF15 0001\x03",
        b"\x0199\x05WS08 0001\x03",
        b"\x0199\x05g\x03",
        b"\x0199\x05WS05 9C41\x03",
    ],
)
def test_broadcast_outside_the_allowed_functions_is_ignored(request_):
    inverter, _, _ = meet()
    held = {name: inverter.peek(name, 0.0) for name in ("S05", "S08", "F15")}
    assert heard(inverter, frame(request_)) == []
    assert {name: inverter.peek(name, 0.0) for name in held} == held


def test_vector_inverter_obeys_every_s_code_as_broadcast():
    inverter, _, _ = meet("vg")
    assert heard(inverter, frame(b"\x0199\x05WS08 0001\x03")) == []
    assert inverter.peek("S08", 0.0) == 1
    assert heard(inverter, frame(b"\x0199\x05e0BB8\x03")) == []
    assert inverter.peek("S05", 0.0) == 3000
    inverter.trip(3, 0.0)
    assert heard(inverter, frame(b"\x0199\x05E        \x03")) == []
    assert inverter.motor.fault == 0


# Models written by users


def test_minimal_model_makes_a_drive_without_identity_and_start(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(
        'format = 1\nprotocol = "fuji"\nname = "small"\n[[parameter]]\naddress = "M14"\nname = "status"\n'
        'type = "[16]"\naccess = "r"\n[[parameter]]\naddress = "M01"\nname = "reference"\naccess = "r"\n'
    )
    inverter = virtual_drive("fuji", 1, model=path)
    line, bus = line_of(inverter)
    drive = bus.drive("fuji", 1, model=path)
    assert drive.status().state is DriveState.READY
    assert drive.identify() == {}
    with pytest.raises(RefusedError):
        drive.start()
    inverter.trip(3, line.time)
    assert drive.status().fault_code is None
    assert bus.drive("fuji", 1, short_frames=True).status().fault


# Disturbances


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
@pytest.mark.parametrize("options", [{}, {"short_frames": True}, {"high_speed_writes": True}])
def test_disturbed_exchanges_give_right_values_or_errors(seed, options):
    """Check that no reading shows a value that the drive never held, and that each failure is a DriveCommError."""
    inverter = virtual_drive("fuji", 1)
    line = VirtualLine([inverter], faults=FaultPlan(rate=0.1, seed=seed))
    bus = drivecomm.open_bus(line.port, stored_writes_per_hour=2000)
    drive = bus.drive("fuji", 1, **options)
    steady = ["F07", "F11", "M25", "M23", "E03", "M06", "M14", "y09", "S10", "C31"]
    held = {"S05": {0}, "C05": {500}}
    failures = 0
    for turn in range(2000):
        try:
            if turn % 5 == 4:
                parameter, value = ("S05", turn) if turn % 2 else ("C05", turn)
                held[parameter].add(value)
                drive.write(parameter, value, store=parameter == "C05")
                assert inverter.peek(parameter, line.time) == value
            elif turn % 5 == 3:
                parameter = ("S05", "C05")[turn % 2]
                assert drive.read(parameter).raw in held[parameter]
            else:
                parameter = steady[turn % len(steady)]
                assert drive.read(parameter).raw == inverter.peek(parameter, line.time)
        except DriveCommError:
            failures += 1
    assert failures < 100


def test_foreign_telegrams_are_ignored():
    inverter = virtual_drive("fuji", 1)
    line, bus = line_of(inverter)
    drive = bus.drive("fuji", 1)
    for noise in (b"\x01", b"\x0101\x05", b"\x0101\x05f", bytes(range(256)), b"\x0102\x06RM09 1770\x0300"):
        line.inject(noise)
        assert drive.read("M25").value == 1200


def test_codec_of_the_inverter_reads_a_reply_as_the_protocol_codec():
    inverter, _, _ = meet()
    find = Framer(inverter.codec, "reply").feed(frame(b"\x0101\x06f\x03"))[0]
    assert isinstance(find, Framed)
    assert protocol.codec(FujiOptions()).decode(find.data, "reply") == find.message
