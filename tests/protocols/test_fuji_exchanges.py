"""The conversations of a host with a Fuji inverter, played against scripts."""

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
    """Return the commands that an exchange yields while it gets these replies."""
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


def test_read_with_a_model_is_physical():
    found = play(drive(FRENIC).read("M09"), [(asked("M09"), value("M09", 6000, negative=True))])
    assert (found.value, found.unit, found.raw, found.type) == (Decimal("-60.00"), "Hz", -6000, "[5]")


def test_read_by_name():
    found = play(drive(FRENIC).read("operation_status"), [(asked("M14"), value("M14", 0x1221))])
    assert found.text == "FWD, NUV, ACC, RL"


def test_read_without_a_model():
    found = play(drive().read("M09"), [(asked("M09"), value("M09", 6000))])
    assert (found.value, found.type) == (6000, "")


@pytest.mark.parametrize("format", ["[5]", "5", 5])
def test_read_with_a_format(format):
    found = play(drive().read("C05", format=format), [(asked("C05"), value("C05", 0x13A1))])
    assert (found.value, found.type, found.unit) == (Decimal("50.25"), "[5]", "")


def test_read_with_a_format_of_the_first_generation():
    found = play(drive(profile="e11s").read("M09", format=11), [(asked("M09"), value("M09", 6000, negative=True))])
    assert found.value == Decimal("-60.00")


def test_read_with_a_format_that_does_not_exist():
    with pytest.raises(UsageError):
        drive().read("M09", format="[99]")


@pytest.mark.parametrize(
    ("code", "reason"), [(78, "unknown function code"), (99, "unlisted error 99"), (None, "no code is known")]
)
def test_read_refused(code, reason):
    with pytest.raises(RefusedError, match=reason) as caught:
        play(drive().read("M99"), [(asked("M99"), refused("M99", code))])
    assert (caught.value.parameter, caught.value.code) == ("M99", code)


@pytest.mark.parametrize(("letter", "function"), [("g", "M06"), ("h", "M07"), ("j", "M09"), ("k", "M14")])
def test_read_with_short_frames(letter, function):
    request = Poll(kind="request", address=1, command=letter)
    found = play(
        drive(FRENIC, short_frames=True).read(function),
        [(request, Poll(kind="ack", address=1, command=letter, data=0xB1E0))],
    )
    assert found.raw == 0xB1E0
    assert ("no room for a sign" in found.note) == (letter == "j")


def test_read_without_a_short_frame_uses_the_standard_one():
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


def test_standard_refusal_of_a_short_frame_needs_no_m26():
    request = Poll(kind="request", address=1, command="g")
    with pytest.raises(RefusedError, match="unknown command"):
        play(drive(short_frames=True).read("M06"), [(request, refused(None, 75))])


# Writing


def test_commands_are_volatile():
    assert play(drive(FRENIC).write("S05", "50.25"), write_steps(("S05", 0x13A1))) is None
    with pytest.raises(NotSupported, match="S05 is not kept without mains"):
        drive(FRENIC).write("S05", 50, store=True)


def test_other_writes_are_stored_and_say_so():
    assert play(drive(FRENIC).write("F07", "20.0", store=True), write_steps(("F07", 0x04C8))) is None
    with pytest.raises(NotSupported, match="F07 may go to the EEPROM"):
        drive(FRENIC).write("F07", "20.0")


@pytest.mark.parametrize("parameter", ["M09", "M26"])
def test_monitor_data_are_read_only(parameter):
    for model in (None, FRENIC):
        with pytest.raises(NotSupported, match="read only"):
            drive(model).write(parameter, 1)


def test_read_only_by_the_model():
    with pytest.raises(NotSupported, match="read only"):
        drive(load_model("drivecomm_fuji", "fuji", "vg"), profile="vg").write("H34", 1, store=True)


def test_values_that_do_not_fit_send_nothing():
    for wrong in ("400.01", "0.005", "x"):
        with pytest.raises(ValueRefusedError):
            drive(FRENIC).write("S05", wrong)


def test_busy_inverters_are_asked_again():
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


def test_patience_ends():
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
def test_attempts_and_patience_of_writes(parameter, raw, attempts, timeout):
    (ask,) = commands(drive().write(parameter, raw, store=parameter[0] != "S"), [done(parameter)])
    assert ask == Ask(
        message=written(parameter, raw), attempts=attempts, acts=True, nameless=True, reply_timeout_s=timeout
    )


def test_response_interval_is_added():
    (ask,) = commands(drive(response_interval_s=1.0).read("M09"), [value("M09", 0)])
    assert ask == Ask(message=asked("M09"), reply_timeout_s=1.1)
    (ask,) = commands(drive(response_interval_s=1.0).probe(), [value("M14", 0)])
    assert ask == Ask(message=asked("M14"), attempts=1, reply_timeout_s=1.1)


def test_high_speed_writes():
    (ask,) = commands(drive(high_speed_writes=True).write("F15", 60, store=True), [done("F15", "A")])
    assert ask == Ask(message=written("F15", 60, "A"), acts=True, nameless=True)
    play(drive(high_speed_writes=True, profile="e11s").write("S08", 10), write_steps(("S08", 10)))


@pytest.mark.parametrize(("function", "letter"), [("S01", "a"), ("S05", "e"), ("S06", "f")])
def test_write_with_short_frames(function, letter):
    request = Select(kind="request", address=1, command=letter, data=1)
    ack = Select(kind="ack", address=1, command=letter)
    assert play(drive(short_frames=True).write(function, 1), [(request, ack)]) is None
    nak = Select(kind="nak", address=1, command=letter)
    with pytest.raises(RefusedError, match="link priority"):
        play(drive(short_frames=True).write(function, 1), [(request, nak), (asked("M26"), value("M26", 76))])


def test_short_frames_of_the_vector_inverter():
    request = Select(kind="request", address=1, command="b", data=1)
    ack = Select(kind="ack", address=1, command="b")
    play(drive(short_frames=True, profile="vg").write("S02", 1), [(request, ack)])
    play(drive(short_frames=True).write("S02", 1), write_steps(("S02", 1)))


def test_both_references_are_warned_of():
    one = drive(FRENIC)
    assert play(one.write("S01", 10000), write_steps(("S01", 10000))) is None
    found = play(one.write("S05", "30.00"), write_steps(("S05", 3000)))
    assert (found.value, found.note) == (Decimal("30.00"), "S01 is not zero and beats S05, so S05 has no effect")
    assert play(one.write("S01", 0), write_steps(("S01", 0))) is None


# Running


def test_start_looks_for_an_alarm_first_and_is_sent_once():
    sent = commands(drive().start(), [value("M14", IDLE), done("S06")])
    assert sent == [
        Ask(message=asked("M14")),
        Ask(message=written("S06", 1), attempts=1, acts=True, nameless=True),
    ]


def test_start_reverse():
    play(drive().start(reverse=True), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 2))])


def test_start_with_an_alarm():
    steps = [(asked("M14"), value("M14", ALARM)), (asked("M16"), value("M16", 3))]
    with pytest.raises(StateError, match="code 3"):
        play(drive().start(), steps)


def test_stop_is_repeated_if_need_be():
    (ask,) = commands(drive().stop(), [done("S06")])
    assert ask == Ask(message=written("S06", 0), acts=True, nameless=True, urgent=True)


@pytest.mark.parametrize("how", [Stop.COAST, Stop.QUICK, Stop.DC_BRAKE])
def test_other_stops_are_not_there(how):
    assert drive().capabilities.stops == {Stop.RAMP}
    with pytest.raises(NotSupported, match=how.value):
        drive().stop(how)


def test_coasting_needs_a_terminal_and_start_takes_it_back():
    one = drive(coast_terminal="X3")
    assert one.capabilities.stops == {Stop.RAMP, Stop.COAST}
    play(one.stop(Stop.COAST), write_steps(("S06", 0x0010)))
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 0x0001))])
    with pytest.raises(NotSupported, match="no quick stop over the bus; use ramp, or coast with the terminal"):
        one.stop(Stop.QUICK)


def test_terminals_keep_their_state():
    one = drive()
    play(one.extra["terminals"](X1=True, X5=True), [*STANDS, *write_steps(("S06", 0x0044))])
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 0x0045))])
    confirmed = [*RUNS_BY, (asked("S06"), value("S06", 0x0045))]
    play(one.terminals(X1=False, XF=True), [*confirmed, *write_steps(("S06", 0x2041))])
    play(one.stop(), write_steps(("S06", 0x2040)))
    # It runs on while it ramps down, and nobody commands it to.
    play(one.terminals(X1=True), [*RUNS_BY, (asked("S06"), value("S06", 0x2040)), *write_steps(("S06", 0x2044))])
    with pytest.raises(UsageError, match="no terminal 'X10'"):
        one.terminals(X10=True)


def test_terminals_while_running_are_sent_once():
    one = drive()
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 1))])
    sent = commands(one.terminals(X1=True), [value("M14", RUNNING), value("S06", 1), done("S06")])
    assert (sent[-1].message.data, sent[-1].attempts) == (5, 1)


@pytest.mark.parametrize("held", [0, 2, 1])
@pytest.mark.parametrize("lost", ["nothing", "forget"])
def test_terminals_neither_stop_nor_start_what_somebody_else_commands(held, lost):
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


def test_a_motor_that_stands_has_no_run_command_that_could_be_repeated():
    memory = FujiMemory()
    one, other = (FujiOperations(1, FujiOptions(), None, memory) for _ in range(2))
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    play(other.status(), STANDS)
    assert memory.word == 0
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_a_stop_is_remembered_before_it_is_sent():
    memory = FujiMemory()
    one = FujiOperations(1, FujiOptions(), None, memory)
    play(one.start(), [*STANDS, *write_steps(("S06", 1))])
    next(one.stop())
    assert memory.word == 0


def test_a_start_that_was_not_confirmed_is_not_repeated_by_terminals():
    one = drive()
    with pytest.raises(NoReplyError):
        play(one.start(), [(asked("M14"), value("M14", IDLE)), (written("S06", 1), LOST)])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_an_alarm_takes_the_run_command_from_memory():
    one = drive()
    play(one.start(), [(asked("M14"), value("M14", IDLE)), *write_steps(("S06", 1))])
    play(one.status(), [(asked("M14"), value("M14", ALARM)), (asked("M16"), value("M16", 3))])
    play(one.terminals(X1=True), [*STANDS, *write_steps(("S06", 0x0004))])


def test_written_operation_commands_are_remembered():
    one = drive()
    (ask,) = commands(one.write("S06", 0x0005), [done("S06")])
    assert ask.attempts == 1
    play(one.stop(), write_steps(("S06", 0x0004)))
    for wrong in (3, 0x0800):
        with pytest.raises(ValueRefusedError):
            one.write("S06", wrong)


def test_digital_outputs():
    assert play(drive().extra["digital_outputs"](Y1=True, Y2=False, Y5=True), write_steps(("S07", 0x0011))) is None
    with pytest.raises(UsageError, match="Y1 to Y5"):
        drive().digital_outputs(Y6=True)
    with pytest.raises(NotSupported, match="S07"):
        drive(profile="e11s").digital_outputs(Y1=True)


# Resetting


def test_reset_takes_the_run_command_away_first():
    sent = commands(drive().reset(), [value("M14", ALARM), done("S06"), done("S06"), done("S06"), value("M14", IDLE)])
    assert [(command.message.function, command.message.data, command.attempts) for command in sent] == [
        ("M14", None, None),
        ("S06", 0x0000, None),
        ("S06", 0x8000, 1),
        ("S06", 0x0000, None),
        ("M14", None, None),
    ]


def test_reset_keeps_terminals():
    one = drive()
    play(one.write("S06", 0x0005), write_steps(("S06", 0x0005)))
    steps = [
        (asked("M14"), value("M14", ALARM)),
        *write_steps(("S06", 0x0004), ("S06", 0x8004), ("S06", 0x0004)),
        (asked("M14"), value("M14", IDLE)),
    ]
    play(one.reset(), steps)


def test_reset_without_an_alarm_does_nothing():
    play(drive().reset(), [(asked("M14"), value("M14", RUNNING))])
    play(drive().reset_by_command("m"), [(asked("M14"), value("M14", RUNNING))])


@pytest.mark.parametrize("cleared", [done("S06"), LOST])
def test_reset_bit_is_taken_back_even_if_it_was_not_confirmed(cleared):
    steps = [
        (asked("M14"), value("M14", ALARM)),
        *write_steps(("S06", 0)),
        (written("S06", 0x8000), LOST),
        (written("S06", 0), cleared),
    ]
    with pytest.raises(NoReplyError):
        play(drive().reset(), steps)


def test_alarm_that_stays():
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
def test_reset_by_command(command, request_, reply):
    sent = commands(
        drive().extra["reset_by_command"](command), [value("M14", ALARM), done("S06"), reply, value("M14", IDLE)]
    )
    assert sent[1].message == written("S06", 0)
    assert sent[2] == Ask(message=request_, attempts=1, acts=True, nameless=True)


def test_reset_by_other_commands():
    with pytest.raises(UsageError, match="E and m"):
        drive().reset_by_command("R")


# References


def shown(function, data):
    return (asked(function), value(function, data))


def test_frequency_takes_s01_back_first_whatever_was_before():
    one = drive()
    for _ in range(2):
        play(one.set_reference_hz("50.25"), [*write_steps(("S01", 0), ("S05", 5025)), shown("M05", 5026)])


@pytest.mark.parametrize("other", [4000, 5027])
def test_another_reference_that_holds_is_told(other):
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
def test_reference_is_refused_by_a_zero_only_while_the_motor_runs(verb, wanted, written, function):
    steps = [*write_steps(*written), shown(function, 0)]
    play(getattr(drive(), verb)(wanted), [*steps, shown("M14", 0)])
    with pytest.raises(StateError, match="took a reference of 50"):
        play(getattr(drive(), verb)(wanted), [*steps, shown("M14", 0b01)])


def test_an_inverter_that_shows_no_reference_needs_somebody_who_says_so():
    steps = write_steps(("S01", 0), ("S05", 3000))
    with pytest.raises(StateError, match="reference_read_back=False"):
        play(drive().set_reference_hz(30), [*steps, (asked("M05"), refused("M05", 78))])
    play(drive(reference_read_back=False).set_reference_hz(30), steps)


@pytest.mark.parametrize("wrong", ["50.005", -1, "400.01", "x"])
def test_frequencies_that_are_refused(wrong):
    with pytest.raises(ValueRefusedError):
        drive().set_reference_hz(wrong)


def test_percent_takes_s05_back_first_for_it_would_count_with_s01_at_zero():
    one = drive()
    for percent, sent, back in (
        ("-50.005", 0x10000 - 10001, 10001),
        ("-50.005", 0x10000 - 10001, 0x10000 - 9999),
        (0, 0, 0),
    ):
        steps = [*write_steps(("S05", 0), ("S01", sent)), shown("M01", back)]
        play(one.set_reference_percent(percent), steps)


@pytest.mark.parametrize("wrong", ["100.005", "-101", "0.001"])
def test_percents_that_are_refused(wrong):
    with pytest.raises(ValueRefusedError):
        drive().set_reference_percent(wrong)


def test_vector_inverters_take_frequencies_per_unit():
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
def test_status(word, state, running, reverse):
    found = play(drive().status(), [(asked("M14"), value("M14", word))])
    assert (found.word, found.state, found.running, found.reverse) == (word, state, running, reverse)
    assert not found.fault
    assert found.remote == bool(word & 0x1000)


def test_status_with_an_alarm():
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


def test_status_without_an_alarm_memory():
    steps = [(asked("M14"), value("M14", ALARM)), (asked("M16"), refused("M16", 78))]
    assert play(drive(FRENIC).status(), steps).fault_code is None


def test_status_by_short_frame():
    request = Poll(kind="request", address=1, command="k")
    found = play(drive(short_frames=True).status(), [(request, Poll(kind="ack", address=1, command="k", data=RUNNING))])
    assert found.running


# Presence


def test_probe_asks_once_and_takes_a_refusal_for_presence():
    (ask,) = commands(drive().probe(), [refused("M14", 78)])
    assert ask == Ask(message=asked("M14"), attempts=1)


def test_identify():
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


def test_broadcasts_are_told():
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


def test_broadcasts_never_use_high_speed_writes():
    (tell,) = commands(drive(address=99, high_speed_writes=True).write("S05", 1), [])
    assert tell.message.command == "W"
    (tell,) = commands(drive(address=99, short_frames=True).write("S05", 1), [])
    assert tell.message == Select(kind="request", address=99, command="e", data=1)


def test_what_cannot_be_broadcast():
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
