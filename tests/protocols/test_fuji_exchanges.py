"""Conversations of a host with a Fuji inverter, played against scripts."""

from __future__ import annotations

from decimal import Decimal

import pytest

from drivecomm import NoReplyError, NotSupported, RefusedError, StateError, Stop, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.protocol import Ask, DriveState, Pause, Tell
from drivecomm.testing import play
from drivecomm_fuji.asking import FujiMemory
from drivecomm_fuji.exchanges import FujiOperations
from drivecomm_fuji.options import FujiOptions
from drivecomm_fuji.telegrams import Poll, Select, Standard

FRENIC = load_model("drivecomm_fuji", "fuji", "frenic")
LOST = NoReplyError("nothing came")

IDLE, RUNNING, ALARM = 0x1028, 0x1021, 0x1828


def drive(model=None, address=1, **options):
    return FujiOperations(address, FujiOptions(**options), model)


def asked(function, command="R", address=1, data=None):
    return Standard(kind="request", address=address, command=command, function=function, data=data)


def written(function, data, command="W", address=1):
    return asked(function, command, address, data)


def value(function, data, *, negative=False):
    return Standard(kind="ack", address=1, command="R", function=function, data=data, negative=negative)


def done(function, command="W"):
    return Standard(kind="ack", address=1, command=command, function=function, data=0)


def refused(function, code, command="R"):
    return Standard(kind="nak", address=1, command=command, function=function, error_code=code)


def write_steps(*pairs):
    return [(written(function, data), done(function)) for function, data in pairs]


STANDS = [(asked("M14"), value("M14", IDLE))]
RUNS_BY = [(asked("M14"), value("M14", RUNNING))]


def commands(exchange, replies):
    """Return the commands that an exchange yields when it receives these replies."""
    sent = []
    answers = iter(replies)
    try:
        command = next(exchange)
        while True:
            sent.append(command)
            answer = next(answers) if isinstance(command, Ask) else None
            command = exchange.throw(answer) if isinstance(answer, Exception) else exchange.send(answer)
    except StopIteration:
        return sent


# Reading


def test_read_with_a_model_returns_the_physical_value():
    found = play(drive(FRENIC).read("M09"), [(asked("M09"), value("M09", 6000, negative=True))])
    assert (found.value, found.unit, found.raw, found.type) == (Decimal("-60.00"), "Hz", -6000, "[5]")


def test_parameter_is_read_by_its_name():
    found = play(drive(FRENIC).read("operation_status"), [(asked("M14"), value("M14", 0x1221))])
    assert found.text == "FWD, NUV, ACC, RL"


def test_read_without_a_model_returns_the_plain_number():
    found = play(drive().read("M09"), [(asked("M09"), value("M09", 6000))])
    assert (found.value, found.type) == (6000, "")


@pytest.mark.parametrize("format", ["[5]", "5", 5])
def test_read_with_a_given_format_scales_the_value(format):
    found = play(drive().read("C05", format=format), [(asked("C05"), value("C05", 0x13A1))])
    assert (found.value, found.type, found.unit) == (Decimal("50.25"), "[5]", "")


def test_read_with_a_format_of_the_first_generation():
    found = play(drive(profile="e11s").read("M09", format=11), [(asked("M09"), value("M09", 6000, negative=True))])
    assert found.value == Decimal("-60.00")


def test_read_with_an_unknown_format_is_refused():
    with pytest.raises(UsageError):
        drive().read("M09", format="[99]")


@pytest.mark.parametrize(
    ("code", "reason"), [(78, "unknown function code"), (99, "unlisted error 99"), (None, "no code is known")]
)
def test_refused_read_has_code_and_reason(code, reason):
    with pytest.raises(RefusedError, match=reason) as caught:
        play(drive().read("M99"), [(asked("M99"), refused("M99", code))])
    assert (caught.value.parameter, caught.value.code) == ("M99", code)


@pytest.mark.parametrize(("letter", "function"), [("g", "M06"), ("h", "M07"), ("j", "M09"), ("k", "M14")])
def test_read_uses_a_short_frame_if_enabled(letter, function):
    request = Poll(kind="request", address=1, command=letter)
    found = play(
        drive(FRENIC, short_frames=True).read(function),
        [(request, Poll(kind="ack", address=1, command=letter, data=0xB1E0))],
    )
    assert found.raw == 0xB1E0
    assert ("no room for a sign" in found.note) == (letter == "j")


def test_read_of_a_function_without_a_short_frame_uses_the_standard_one():
    play(drive(short_frames=True).read("M08"), [(asked("M08"), value("M08", 0))])
    request = Poll(kind="request", address=1, command="i")
    play(
        drive(short_frames=True, profile="vg").read("M08"),
        [(request, Poll(kind="ack", address=1, command="i", data=0))],
    )


def test_short_frame_j_can_be_signed():
    request = Poll(kind="request", address=1, command="j")
    found = play(
        drive(FRENIC, short_frames=True, signed_j=True).read("M09"),
        [(request, Poll(kind="ack", address=1, command="j", data=0x10000 - 6000))],
    )
    assert (found.value, found.raw) == (Decimal("-60.00"), -6000)


def test_short_refusal_is_explained_by_m26():
    request, nak = Poll(kind="request", address=1, command="g"), Poll(kind="nak", address=1, command="g")
    cases = [
        ((asked("M26"), value("M26", 75)), 75),
        ((asked("M26"), value("M26", 0)), None),
        ((asked("M26"), refused("M26", 78)), None),
        ((asked("M26"), LOST), None),
    ]
    for step, code in cases:
        with pytest.raises(RefusedError) as caught:
            play(drive(short_frames=True).read("M06"), [(request, nak), step])
        assert caught.value.code == code


def test_standard_refusal_of_a_short_frame_does_not_read_m26():
    request = Poll(kind="request", address=1, command="g")
    with pytest.raises(RefusedError, match="unknown command"):
        play(drive(short_frames=True).read("M06"), [(request, refused(None, 75))])


# Writing


def test_command_functions_refuse_stored_writes():
    assert play(drive(FRENIC).write("S05", "50.25"), write_steps(("S05", 0x13A1))) is None
    with pytest.raises(NotSupported, match="S05 is not kept without mains"):
        drive(FRENIC).write("S05", 50, store=True)


def test_other_functions_refuse_volatile_writes():
    assert play(drive(FRENIC).write("F07", "20.0", store=True), write_steps(("F07", 0x04C8))) is None
    with pytest.raises(NotSupported, match="F07 may go to the EEPROM"):
        drive(FRENIC).write("F07", "20.0")


@pytest.mark.parametrize("parameter", ["M09", "M26"])
def test_monitor_data_are_read_only(parameter):
    for model in (None, FRENIC):
        with pytest.raises(NotSupported, match="read only"):
            drive(model).write(parameter, 1)


def test_write_to_a_read_only_parameter_of_the_model_is_refused():
    with pytest.raises(NotSupported, match="read only"):
        drive(load_model("drivecomm_fuji", "fuji", "vg"), profile="vg").write("H34", 1, store=True)


def test_value_that_does_not_fit_is_refused_unsent():
    for wrong in ("400.01", "0.005", "x"):
        with pytest.raises(ValueRefusedError):
            drive(FRENIC).write("S05", wrong)


def test_busy_inverter_is_retried_after_a_pause():
    request = written("F07", 0x04C8)
    sent = commands(
        drive(FRENIC).write("F07", 20, store=True), [refused("F07", 81, "W"), refused("F07", 81, "W"), done("F07")]
    )
    assert sent == [
        ask := Ask(message=request, acts=True, nameless=True, reply_timeout_s=0.5),
        Pause(seconds=0.1),
        ask,
        Pause(seconds=0.1),
        ask,
    ]


def test_busy_refusal_is_raised_after_the_last_repeat():
    steps = [(written("F07", 0x04C8), refused("F07", 81, "W"))] * 3
    with pytest.raises(RefusedError) as caught:
        play(drive(FRENIC, busy_repeats=2).write("F07", 20, store=True), steps)
    assert caught.value.code == 81


@pytest.mark.parametrize("code", [74, 75, 76, 77, 78, 79, 80])
def test_refused_writes_are_not_repeated(code):
    with pytest.raises(RefusedError) as caught:
        play(drive(FRENIC).write("F07", 20, store=True), [(written("F07", 0x04C8), refused("F07", code, "W"))])
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("parameter", "raw", "attempts", "timeout"),
    [
        ("S05", 100, None, None),
        ("F15", 60, None, 0.5),
        ("H03", 1, 1, 10.0),
        ("H03", 2, None, 1.0),
        ("P04", 1, 1, 300.0),
    ],
)
def test_slow_writes_have_their_own_timeouts_and_attempts(parameter, raw, attempts, timeout):
    (ask,) = commands(drive().write(parameter, raw, store=parameter[0] != "S"), [done(parameter)])
    assert ask == Ask(
        message=written(parameter, raw), attempts=attempts, acts=True, nameless=True, reply_timeout_s=timeout
    )


def test_response_interval_extends_the_reply_timeout():
    (ask,) = commands(drive(response_interval_s=1.0).read("M09"), [value("M09", 0)])
    assert ask == Ask(message=asked("M09"), reply_timeout_s=1.1)
    (ask,) = commands(drive(response_interval_s=1.0).probe(), [value("M14", 0)])
    assert ask == Ask(message=asked("M14"), attempts=1, reply_timeout_s=1.1)


def test_high_speed_writes_use_command_a_if_the_profile_has_it():
    (ask,) = commands(drive(high_speed_writes=True).write("F15", 60, store=True), [done("F15", "A")])
    assert ask == Ask(message=written("F15", 60, "A"), acts=True, nameless=True)
    play(drive(high_speed_writes=True, profile="e11s").write("S08", 10), write_steps(("S08", 10)))


@pytest.mark.parametrize(("function", "letter"), [("S01", "a"), ("S05", "e"), ("S06", "f")])
def test_write_uses_a_short_frame_if_enabled(function, letter):
    request = Select(kind="request", address=1, command=letter, data=1)
    ack = Select(kind="ack", address=1, command=letter)
    assert play(drive(short_frames=True).write(function, 1), [(request, ack)]) is None
    nak = Select(kind="nak", address=1, command=letter)
    with pytest.raises(RefusedError, match="link priority"):
        play(drive(short_frames=True).write(function, 1), [(request, nak), (asked("M26"), value("M26", 76))])


def test_vector_inverter_has_a_short_frame_for_s02():
    request = Select(kind="request", address=1, command="b", data=1)
    ack = Select(kind="ack", address=1, command="b")
    play(drive(short_frames=True, profile="vg").write("S02", 1), [(request, ack)])
    play(drive(short_frames=True).write("S02", 1), write_steps(("S02", 1)))


def test_write_to_s05_notes_that_s01_overrides_it():
    one = drive(FRENIC)
    assert play(one.write("S01", 10000), write_steps(("S01", 10000))) is None
    found = play(one.write("S05", "30.00"), write_steps(("S05", 3000)))
    assert (found.value, found.note) == (Decimal("30.00"), "S01 is not zero and beats S05, so S05 has no effect")
    assert play(one.write("S01", 0), write_steps(("S01", 0))) is None


# Running


def test_start_first_checks_for_an_alarm_and_is_sent_once():
    sent = commands(drive().start(), [value("M14", IDLE), done("S06")])
    assert sent == [
        Ask(message=asked("M14")),
        Ask(message=written("S06", 1), attempts=1, acts=True, nameless=True),
    ]


def test_reverse_start_writes_rev():
    play(drive().start(reverse=True), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 2))])


def test_start_with_an_alarm_is_refused_with_its_code():
    steps = [(asked("M14"), value("M14", ALARM)), (asked("M16"), value("M16", 3))]
    with pytest.raises(StateError, match="code 3"):
        play(drive().start(), steps)


def test_stop_may_be_repeated_and_is_urgent():
    (ask,) = commands(drive().stop(), [done("S06")])
    assert ask == Ask(message=written("S06", 0), acts=True, nameless=True, urgent=True)


@pytest.mark.parametrize("how", [Stop.COAST, Stop.QUICK, Stop.DC_BRAKE])
def test_other_stops_than_ramp_are_refused(how):
    assert drive().capabilities.stops == {Stop.RAMP}
    with pytest.raises(NotSupported, match=how.value):
        drive().stop(how)


def test_coast_uses_its_terminal_and_start_clears_it():
    one = drive(coast_terminal="X3")
    assert one.capabilities.stops == {Stop.RAMP, Stop.COAST}
    play(one.stop(Stop.COAST), write_steps(("S06", 0x0010)))
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 0x0001))])
    with pytest.raises(NotSupported, match="no quick stop over the bus; use ramp, or coast with the terminal"):
        one.stop(Stop.QUICK)


def test_terminal_bits_are_kept_in_each_operation_command():
    one = drive()
    play(one.extra["terminals"](X1=True, X5=True), [*STANDS, *write_steps(("S06", 0x0044))])
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 0x0045))])
    confirmed = [*RUNS_BY, (asked("S06"), value("S06", 0x0045))]
    play(one.terminals(X1=False, XF=True), [*confirmed, *write_steps(("S06", 0x2041))])
    play(one.stop(), write_steps(("S06", 0x2040)))
    # The motor runs while it ramps down, but no run command holds.
    play(one.terminals(X1=True), [*RUNS_BY, (asked("S06"), value("S06", 0x2040)), *write_steps(("S06", 0x2044))])
    with pytest.raises(UsageError, match="no terminal 'X10'"):
        one.terminals(X10=True)


def test_terminal_write_while_running_is_sent_once():
    one = drive()
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 1))])
    sent = commands(one.terminals(X1=True), [value("M14", RUNNING), value("S06", 1), done("S06")])
    assert (sent[-1].message.data, sent[-1].attempts) == (5, 1)


@pytest.mark.parametrize("held", [0, 2, 1])
@pytest.mark.parametrize("lost", ["nothing", "forget"])
def test_terminal_write_keeps_the_run_command_of_another_master(held, lost):
    memory = FujiMemory()
    one = FujiOperations(1, FujiOptions(), None, memory)
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    if lost != "nothing":
        getattr(memory, lost)()
    steps = [*RUNS_BY, (asked("S06"), value("S06", held))]
    if held == (lost == "nothing"):
        play(one.terminals(X1=True), [*steps, *write_steps(("S06", 0x0004 | held))])
        return
    with pytest.raises(StateError, match="start or stop it from here first"):
        play(one.terminals(X1=True), steps)
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_run_command_is_forgotten_when_the_motor_is_seen_stopped():
    memory = FujiMemory()
    one, other = (FujiOperations(1, FujiOptions(), None, memory) for _ in range(2))
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    play(other.status(), STANDS)
    assert memory.word == 0
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_stop_is_remembered_before_it_is_sent():
    memory = FujiMemory()
    one = FujiOperations(1, FujiOptions(), None, memory)
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    next(one.stop())
    assert memory.word == 0


def test_unconfirmed_start_is_not_repeated_by_a_terminal_write():
    one = drive()
    with pytest.raises(NoReplyError):
        play(one.start(), [(asked("M14"), value("M14", IDLE)), (written("S06", 1), LOST)])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_alarm_clears_the_remembered_run_command():
    one = drive()
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 1))])
    play(one.status(), [(asked("M14"), value("M14", ALARM)), (asked("M16"), value("M16", 3))])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_operation_command_written_to_s06_is_remembered():
    one = drive()
    (ask,) = commands(one.write("S06", 0x0005), [done("S06")])
    assert ask.attempts == 1
    play(one.stop(), write_steps(("S06", 0x0004)))
    for wrong in (3, 0x0800):
        with pytest.raises(ValueRefusedError):
            one.write("S06", wrong)


def test_digital_outputs_are_written_to_s07():
    assert play(drive().extra["digital_outputs"](Y1=True, Y2=False, Y5=True), write_steps(("S07", 0x0011))) is None
    with pytest.raises(UsageError, match="Y1 to Y5"):
        drive().digital_outputs(Y6=True)
    with pytest.raises(NotSupported, match="S07"):
        drive(profile="e11s").digital_outputs(Y1=True)


# Resetting


def test_reset_first_clears_the_run_command():
    sent = commands(drive().reset(), [value("M14", ALARM), done("S06"), done("S06"), done("S06"), value("M14", IDLE)])
    assert [(command.message.function, command.message.data, command.attempts) for command in sent] == [
        ("M14", None, None),
        ("S06", 0x0000, None),
        ("S06", 0x8000, 1),
        ("S06", 0x0000, None),
        ("M14", None, None),
    ]


def test_reset_keeps_the_terminal_bits():
    one = drive()
    play(one.write("S06", 0x0005), write_steps(("S06", 0x0005)))
    steps = [
        (asked("M14"), value("M14", ALARM)),
        *write_steps(("S06", 0x0004), ("S06", 0x8004), ("S06", 0x0004)),
        (asked("M14"), value("M14", IDLE)),
    ]
    play(one.reset(), steps)


def test_reset_without_an_alarm_writes_nothing():
    play(drive().reset(), [(asked("M14"), value("M14", RUNNING))])
    play(drive().reset_by_command("m"), [(asked("M14"), value("M14", RUNNING))])


@pytest.mark.parametrize("cleared", [done("S06"), LOST])
def test_reset_bit_is_cleared_even_if_it_was_not_confirmed(cleared):
    steps = [
        (asked("M14"), value("M14", ALARM)),
        *write_steps(("S06", 0)),
        (written("S06", 0x8000), LOST),
        (written("S06", 0), cleared),
    ]
    with pytest.raises(NoReplyError):
        play(drive().reset(), steps)


def test_reset_of_a_lasting_alarm_raises_state_error():
    steps = [
        (asked("M14"), value("M14", ALARM)),
        *write_steps(("S06", 0), ("S06", 0x8000), ("S06", 0)),
        (asked("M14"), value("M14", ALARM)),
        (asked("M14"), value("M14", ALARM)),
        (asked("M14"), value("M14", ALARM)),
    ]
    with pytest.raises(StateError, match="still there"):
        play(drive(reset_timeout_s=0.1).reset(), steps)


@pytest.mark.parametrize(
    ("command", "request_", "reply"),
    [
        (
            "E",
            Standard(kind="request", address=1, command="E"),
            Standard(kind="ack", address=1, command="E"),
        ),
        (
            "m",
            Select(kind="request", address=1, command="m", data=0),
            Select(kind="ack", address=1, command="m"),
        ),
    ],
)
def test_reset_by_command_sends_e_or_m_once(command, request_, reply):
    sent = commands(
        drive().extra["reset_by_command"](command), [value("M14", ALARM), done("S06"), reply, value("M14", IDLE)]
    )
    assert sent[1].message == written("S06", 0)
    assert sent[2] == Ask(message=request_, attempts=1, acts=True, nameless=True)


def test_reset_by_another_command_is_refused():
    with pytest.raises(UsageError, match="E and m"):
        drive().reset_by_command("R")


# References


def shown(function, data):
    return (asked(function), value(function, data))


def test_reference_in_hz_always_clears_s01_first():
    one = drive()
    for _ in range(2):
        play(one.set_reference_hz("50.25"), [*write_steps(("S01", 0), ("S05", 5025)), shown("M05", 5026)])


@pytest.mark.parametrize("other", [4000, 5027])
def test_reference_that_the_inverter_does_not_adopt_raises_state_error(other):
    steps = [*write_steps(("S01", 0), ("S05", 5025)), shown("M05", other)]
    with pytest.raises(StateError, match=r"took a reference of 50\.25 Hz, and its final reference"):
        play(drive().set_reference_hz("50.25"), steps)
    steps = [*write_steps(("S05", 0), ("S01", 10000)), shown("M01", other)]
    with pytest.raises(StateError, match=r"took a reference of 50\.000 %"):
        play(drive().set_reference_percent(50), steps)


@pytest.mark.parametrize(
    ("verb", "wanted", "written", "function"),
    [
        ("set_reference_hz", "50.25", (("S01", 0), ("S05", 5025)), "M05"),
        ("set_reference_percent", 50, (("S05", 0), ("S01", 10000)), "M01"),
    ],
)
def test_final_reference_of_zero_is_an_error_only_while_running(verb, wanted, written, function):
    steps = [*write_steps(*written), shown(function, 0)]
    play(getattr(drive(), verb)(wanted), [*steps, shown("M14", 0)])
    with pytest.raises(StateError, match="took a reference of 50"):
        play(getattr(drive(), verb)(wanted), [*steps, shown("M14", 0b01)])


def test_unreadable_final_reference_needs_reference_read_back_off():
    steps = write_steps(("S01", 0), ("S05", 3000))
    with pytest.raises(StateError, match="reference_read_back=False"):
        play(drive().set_reference_hz(30), [*steps, (asked("M05"), refused("M05", 78))])
    play(drive(reference_read_back=False).set_reference_hz(30), steps)


@pytest.mark.parametrize("wrong", ["50.005", -1, "400.01", "x"])
def test_invalid_reference_in_hz_is_refused(wrong):
    with pytest.raises(ValueRefusedError):
        drive().set_reference_hz(wrong)


def test_reference_in_percent_always_clears_s05_first():
    one = drive()
    for percent, sent, back in (
        ("-50.005", 0x10000 - 10001, 10001),
        ("-50.005", 0x10000 - 10001, 0x10000 - 9999),
        (0, 0, 0),
    ):
        steps = [*write_steps(("S05", 0), ("S01", sent)), shown("M01", back)]
        play(one.set_reference_percent(percent), steps)


@pytest.mark.parametrize("wrong", ["100.005", "-101", "0.001"])
def test_invalid_reference_in_percent_is_refused(wrong):
    with pytest.raises(ValueRefusedError):
        drive().set_reference_percent(wrong)


def test_vector_inverter_scales_hz_to_the_maximum_frequency():
    one = drive(profile="vg")
    assert not one.capabilities.reference_hz
    with pytest.raises(NotSupported, match="maximum_frequency_hz"):
        one.set_reference_hz(30)
    one = drive(profile="vg", maximum_frequency_hz=60)
    assert one.capabilities.reference_hz
    play(one.set_reference_hz(30), [*write_steps(("S01", 10000)), shown("M01", 10000)])
    for wrong in ("60.01", "0.001", "30.00000000000000000000000000000000001"):
        with pytest.raises(ValueRefusedError):
            one.set_reference_hz(wrong)


# Status


@pytest.mark.parametrize(
    ("word", "state", "running", "reverse"),
    [
        (0x1028, DriveState.READY, False, None),
        (0x0000, DriveState.NOT_READY, False, None),
        (0x1021, DriveState.RUNNING, True, False),
        (0x1022, DriveState.RUNNING, True, True),
    ],
)
def test_status_word_gives_state_running_and_direction(word, state, running, reverse):
    found = play(drive().status(), [(asked("M14"), value("M14", word))])
    assert (found.word, found.state, found.running, found.reverse) == (word, state, running, reverse)
    assert not found.fault
    assert found.remote == bool(word & 0x1000)


def test_status_with_an_alarm_has_code_and_text():
    steps = [(asked("M14"), value("M14", ALARM)), (asked("M16"), value("M16", 10))]
    found = play(drive(FRENIC).status(), steps)
    assert (found.state, found.fault, found.fault_code, found.fault_text) == (
        DriveState.FAULT,
        True,
        10,
        "LU undervoltage",
    )
    assert "ALM" in found.flags
    assert play(drive().status(), steps).fault_text == ""


def test_status_with_an_unreadable_alarm_memory_has_no_code():
    steps = [(asked("M14"), value("M14", ALARM)), (asked("M16"), refused("M16", 78))]
    assert play(drive(FRENIC).status(), steps).fault_code is None


def test_status_uses_a_short_frame_if_enabled():
    request = Poll(kind="request", address=1, command="k")
    found = play(drive(short_frames=True).status(), [(request, Poll(kind="ack", address=1, command="k", data=RUNNING))])
    assert found.running


# Presence


def test_probe_is_sent_once_and_accepts_a_refusal():
    (ask,) = commands(drive().probe(), [refused("M14", 78)])
    assert ask == Ask(message=asked("M14"), attempts=1)


def test_identify_reads_type_code_and_rom_version():
    steps = [
        (asked("M23"), value("M23", 0x1234)),
        (asked("M24"), refused("M24", 78)),
        (asked("M25"), value("M25", 1200)),
    ]
    assert play(drive().identify(), steps) == {
        "type code": "1234 (type 1, generation 2, series 3, voltage 4)",
        "ROM version": "1200",
    }


# All stations


def test_broadcast_verbs_wait_for_no_reply():
    everybody = drive(address=99)
    assert commands(everybody.write("S05", 3000), []) == [Tell(message=written("S05", 3000, address=99))]
    assert commands(everybody.stop(), []) == [Tell(message=written("S06", 0, address=99))]
    assert [tell.message.data for tell in commands(everybody.reset(), [])] == [0, 0x8000, 0]
    (first, second) = commands(everybody.reset_by_command("m"), [])
    assert (first.message.data, second.message.command) == (0, "m")
    assert commands(everybody.set_reference_hz(30), []) == [
        Tell(message=written("S01", 0, address=99)),
        Tell(message=written("S05", 3000, address=99)),
    ]


def test_broadcast_write_never_uses_high_speed_writes():
    (tell,) = commands(drive(address=99, high_speed_writes=True).write("S05", 1), [])
    assert tell.message.command == "W"
    (tell,) = commands(drive(address=99, short_frames=True).write("S05", 1), [])
    assert tell.message == Select(kind="request", address=99, command="e", data=1)


def test_verbs_and_functions_not_allowed_as_broadcast_are_refused():
    everybody = drive(address=99)
    for verb in (everybody.status, everybody.start, everybody.probe, everybody.identify):
        with pytest.raises(NotSupported, match="no drive answers"):
            verb()
    with pytest.raises(NotSupported, match="no drive answers"):
        everybody.read("M09")
    for function in ("F15", "S08"):
        with pytest.raises(NotSupported, match="all stations"):
            everybody.write(function, 1, store=function[0] != "S")
    with pytest.raises(NotSupported, match="S codes can"):
        drive(address=99, profile="vg").write("F15", 1, store=True)
    assert commands(drive(address=99, profile="vg").write("S08", 1), [])
