"""Commands of the FC protocol: which control words are sent, remembered and repeated."""

from contextlib import suppress
from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import CommandTooOldError, NoReplyError, NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.profiles import CommandMemory
from drivecomm.protocol import DriveState, Stop
from drivecomm.testing import play
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_danfoss_fc.exchanges import DanfossFcOperations
from drivecomm_danfoss_fc.messages import ParameterReply, ParameterRequest, ProcessReply, ProcessRequest
from drivecomm_danfoss_fc.options import DanfossFcOptions

FC300 = load_model("drivecomm_danfoss_fc", "danfoss-fc", "fc300")
AT_3 = {"address_format": "1-126", "address": 3}
READY, RUNNING, TRIPPED, LOCAL = 0x0607, 0x0F07, 0x0608, 0x0407


def operations(model=None, *, memory=None, reference=0, **options):
    """A master that has set a reference already, and knows that the drive's watchdog is on."""
    if memory is None:
        memory = CommandMemory()
        memory.reference = reference
        memory.watch(5.0)
    options = {**(model.options if model else {}), "control_word_parameter": "", **options}
    return DanfossFcOperations(3, DanfossFcOptions(**options), model, memory)


def sent(word, reference=0, status=READY, actual=0):
    """A process block and its answer, for the script."""
    request = ProcessRequest(**AT_3, control_word=word, reference=reference)
    return request, ProcessReply(**AT_3, status_word=status, main_actual=actual)


def unanswered(word, reference=0):
    return sent(word, reference)[0], NoReplyError("silence")


LOOK = sent(0, status=RUNNING)
"""How a motor is looked at that runs."""


def read(status=RUNNING):
    """A read of 16-14: whatever was commanded, it carries no control word."""
    parameter = {"pnu": 1614, "ind": 0}
    request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
    return request, ParameterReply(**AT_3, **parameter, ak=2, pwe=524, status_word=status, main_actual=0)


def started(profile="fc", reference=0, **options):
    """A master that has started the motor, and has seen it run."""
    drive = operations(profile=profile, reference=reference, **options)
    steps = [sent(0x047E, reference), sent(0x047F, reference)] if profile == "profidrive" else [sent(0x047C, reference)]
    play(drive.start(), [sent(0), *steps])
    play(drive.read("16-14"), [read()])
    return drive


def repeats(drive, word, reference=0, status=RUNNING):
    """Ask for the status: looked at first, then repeated."""
    play(drive.status(), [sent(0, status=status), sent(word, reference, status)])


def repeats_nothing(drive, status=RUNNING):
    play(drive.status(), [sent(0, status=status)])


class TestWithoutAWatchdog:
    """Nothing has to be repeated, so nothing is."""

    def test_neither_a_start_nor_a_stop_is_repeated(self):
        memory = CommandMemory()
        memory.reference = 0
        drive = operations(memory=memory)
        play(drive.start(), [sent(0), sent(0x047C)])
        repeats_nothing(drive)
        play(drive.stop(), [sent(0x043C, status=RUNNING)])
        repeats_nothing(drive)

    def test_a_start_that_a_tripped_drive_still_keeps_is_taken_back_once(self):
        """Whoever resets it at its keypad would start the motor."""
        memory = CommandMemory()
        memory.reference = 0
        drive = operations(memory=memory)
        play(drive.start(), [sent(0), sent(0x047C)])
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043C, status=TRIPPED)
        repeats_nothing(drive, TRIPPED)

    def test_not_where_somebody_else_has_reset_and_started_it_since(self):
        drive = started()
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats_nothing(drive, RUNNING)


def shows(word, status=RUNNING):
    return shown(1685, word, status)


class TestAnotherMaster:
    """A motor that somebody else has stopped shows as running until it stands; the drive may show by which word."""

    def test_its_stop_is_not_undone(self):
        for verb in (
            lambda drive: drive.status(),
            lambda drive: drive.set_reference_percent(50),
            lambda drive: drive.extra["select_setup"](2),
            lambda drive: drive.extra["hold"](),
        ):
            drive = started(control_word_parameter="16-85")
            with suppress(StateError):
                play(verb(drive), [LOOK, shows(0x043C)])
            repeats_nothing(drive)

    @pytest.mark.parametrize("word", [0x047C, 0, 0x0078, None])
    def test_what_it_shows_of_our_own_words_says_nothing_against_them(self, word):
        """Some drives may show the last word of all, that is the one of the look, others none."""
        drive = started(control_word_parameter="16-85")
        play(drive.status(), [LOOK, shows(word), sent(0x047C, status=RUNNING)])


class TestBeforeAnyCommand:
    def test_reading_carries_no_control_word(self):
        play(operations().read("16-14"), [read()])

    def test_status_carries_no_control_word(self):
        repeats_nothing(operations())

    def test_a_reference_goes_to_a_drive_that_stands_with_the_ramp_stop_word(self):
        drive = operations()
        play(drive.set_reference_percent(50), [sent(0), sent(0x043C, 8192)])
        repeats(drive, 0x043C, 8192, status=READY)
        play(drive.start(), [sent(0), sent(0x047C, 8192)])


def shown(pnu, value, status=READY):
    """A read of a parameter in which the drive shows a word that it got."""
    request = ParameterRequest(**AT_3, pnu=pnu, ind=0, ak=1, pwe=0, control_word=0, reference=0)
    refused = value is None
    reply = ParameterReply(
        **AT_3, pnu=pnu, ind=0, ak=7 if refused else 1, pwe=value or 0, status_word=status, main_actual=0
    )
    return request, reply


def fresh(**options):
    """A program that comes anew, such as each call of the command line."""
    return operations(memory=CommandMemory(), **options)


class TestTakingOver:
    def test_the_reference_that_is_set_is_started_with(self):
        play(fresh().start(), [sent(0), shown(1686, 0xE000), sent(0x047C, -8192)])

    def test_a_drive_that_does_not_show_it_is_not_started_at_zero(self):
        with pytest.raises(StateError, match="no reference was set from here"):
            play(fresh().start(), [sent(0), shown(1686, None)])
        with pytest.raises(StateError, match="no reference was set from here"):
            play(fresh(reference_parameter="").start(), [sent(0)])

    def test_a_motor_that_somebody_else_has_started_is_sent_no_word(self):
        """Not even the one that it shows: by the time it arrives that other one may have stopped the motor."""
        drive = fresh()
        with pytest.raises(StateError, match="came from another program"):
            play(drive.set_reference_percent(50), [LOOK])
        repeats_nothing(drive)
        play(drive.start(), [LOOK, shown(1686, 0x1000), sent(0x047C, 4096, RUNNING)])


class TestStart:
    def test_the_word_and_that_it_is_sent_once(self):
        exchange = operations().start()
        next(exchange)
        command = exchange.send(sent(0)[1])
        assert command.message.control_word == 0x047C
        assert (command.attempts, command.acts, command.command) == (1, True, "new")

    def test_it_is_repeated_by_the_status_while_the_motor_runs(self):
        drive = started()
        play(drive.set_reference_percent(100), [LOOK, sent(0x047C, 16384, RUNNING)])
        play(drive.read("16-14"), [read()])
        repeats(drive, 0x047C, 16384)

    def test_what_repeats_it_says_so(self):
        exchange = started().status()
        assert next(exchange).command == ""
        again = exchange.send(LOOK[1])
        assert (again.command, again.acts, again.urgent) == ("repeated", False, False)

    def test_it_is_not_repeated_before_the_motor_was_seen_to_run(self):
        drive = operations()
        play(drive.start(), [sent(0), sent(0x047C)])
        repeats_nothing(drive, READY)
        repeats(drive, 0x047C)

    def test_it_is_forgotten_as_soon_as_the_motor_does_not_run(self):
        """Stopped by its watchdog, by another master, by a dip of the mains."""
        for find_out in (lambda drive: drive.status(), lambda drive: drive.probe()):
            drive = started()
            play(find_out(drive), [sent(0, status=READY)])
            repeats_nothing(drive)
        drive = started()
        play(drive.read("16-14"), [read(READY)])
        repeats_nothing(drive)

    def test_a_command_that_is_too_old_is_not_repeated(self):
        assert play(started().status(), [LOOK, (sent(0x047C)[0], CommandTooOldError("old"))]).running

    def test_reverse(self):
        play(operations().start(reverse=True), [sent(0), sent(0x847C)])

    @pytest.mark.parametrize(("status", "words"), [(TRIPPED, "tripped"), (LOCAL, "local"), (0x0640, "tripped")])
    def test_a_drive_that_cannot_start_is_not_told_to(self, status, words):
        drive = operations()
        with pytest.raises(StateError, match=words):
            play(drive.start(), [sent(0, status=status)])
        repeats_nothing(drive)

    def test_a_start_without_an_answer_is_not_repeated(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.start(), [sent(0), unanswered(0x047C)])
        repeats_nothing(drive)

    def test_after_a_trip_a_stop_is_repeated_in_its_place(self):
        drive = started()
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043C, status=READY)


class TestStop:
    @pytest.mark.parametrize(
        ("how", "word"),
        [(Stop.RAMP, 0x043C), (Stop.COAST, 0x0474), (Stop.QUICK, 0x046C), (Stop.DC_BRAKE, 0x0478)],
    )
    def test_words(self, how, word):
        drive = started()
        play(drive.stop(how), [sent(word, status=RUNNING)])
        play(drive.read("16-14"), [read()])
        repeats(drive, word)

    def test_a_stop_without_an_answer_is_repeated_by_the_status(self):
        drive = started()
        with pytest.raises(NoReplyError):
            play(drive.stop(), [unanswered(0x043C)])
        repeats(drive, 0x043C)

    def test_a_stop_does_not_stop_what_somebody_else_has_started_since(self):
        drive = started()
        play(drive.stop(), [sent(0x043C)])
        repeats(drive, 0x043C, status=READY)
        repeats_nothing(drive, RUNNING)

    def test_a_stop_that_has_no_effect_is_an_error(self):
        with pytest.raises(StateError, match="local operation"):
            play(operations().stop(), [sent(0x043C, status=LOCAL)])

    def test_a_reference_for_a_stopped_drive_goes_out_with_its_stop_word(self):
        drive = started()
        play(drive.stop(), [sent(0x043C)])
        play(drive.set_reference_percent(25), [sent(0), sent(0x043C, 4096)])
        play(drive.start(), [sent(0), sent(0x047C, 4096)])


class TestReset:
    def test_an_edge_between_two_words_without_it(self):
        script = [sent(0, status=TRIPPED), sent(0x043C, status=TRIPPED), sent(0x04BC, status=TRIPPED), sent(0x043C)]
        play(operations().reset(), script)

    def test_the_edge_is_sent_once(self):
        exchange = operations().reset()
        next(exchange)
        exchange.send(sent(0, status=TRIPPED)[1])
        command = exchange.send(sent(0, status=TRIPPED)[1])
        assert command.message.control_word == 0x04BC
        assert (command.attempts, command.acts) == (1, True)

    def test_the_motor_stays_stopped(self):
        drive = started()
        script = [
            sent(0, status=TRIPPED),
            sent(0x043C, status=TRIPPED),
            sent(0x04BC, status=TRIPPED),
            sent(0x043C, status=TRIPPED),
            sent(0x043C),
        ]
        play(drive.reset(), script)
        repeats(drive, 0x043C, status=READY)

    def test_a_drive_without_a_trip_is_left_alone(self):
        drive = started()
        play(drive.reset(), [LOOK])
        repeats(drive, 0x047C)

    @pytest.mark.parametrize(("status", "words"), [(TRIPPED, "cause"), (TRIPPED | 0x40, "mains")])
    def test_a_trip_that_stays(self, status, words):
        script = [sent(0, status=status), sent(0x043C, status=status), sent(0x04BC, status=status)]
        script += [sent(0x043C, status=status)] * 2
        with pytest.raises(StateError, match=words):
            play(operations(state_timeout_s=0.05).reset(), script)


class TestReference:
    @pytest.mark.parametrize(
        ("percent", "steps"),
        [
            (0, 0),
            (50, 8192),
            (100, 16384),
            ("-100", -16384),
            (-200, -32768),
            ("199.99", 32766),
            (33.3, 5456),
            (Decimal("0.006103515625"), 1),
            (Decimal("0.0030517578125"), 0),
        ],
    )
    def test_percent_to_the_nearest_step(self, percent, steps):
        play(started().set_reference_percent(percent), [LOOK, sent(0x047C, steps, RUNNING)])

    @pytest.mark.parametrize("percent", [200, "-200.01", 10**9, "-1e30", "x", float("nan")])
    def test_beyond_the_word(self, percent):
        with pytest.raises(ValueRefusedError):
            operations().set_reference_percent(percent)

    def test_hertz_need_the_reference_range(self):
        assert not operations().capabilities.reference_hz
        with pytest.raises(NotSupported, match="reference_maximum_hz"):
            operations().set_reference_hz(25)

    def test_hertz(self):
        drive = started(reference_maximum_hz=50)
        assert drive.capabilities.reference_hz
        play(drive.set_reference_hz("25"), [LOOK, sent(0x047C, 8192, RUNNING)])
        play(drive.set_reference_hz(-50), [LOOK, sent(0x047C, -16384, RUNNING)])
        with pytest.raises(ValueRefusedError, match="outside"):
            drive.set_reference_hz(50.1)

    def test_hertz_above_a_minimum(self):
        drive = started(reference_minimum_hz=10, reference_maximum_hz=50)
        play(drive.set_reference_hz(30), [LOOK, sent(0x047C, 8192, RUNNING)])
        for beyond in (9, -30):
            with pytest.raises(ValueRefusedError):
                drive.set_reference_hz(beyond)

    def test_a_reference_that_gets_lost_is_repeated(self):
        drive = started()
        with pytest.raises(NoReplyError):
            play(drive.set_reference_percent(25), [LOOK, unanswered(0x047C, 4096)])
        repeats(drive, 0x047C, 4096)

    @pytest.mark.parametrize("running", [True, False])
    def test_a_motor_that_does_not_run_is_not_started_by_it(self, running):
        """Whether it was seen to run since its start or not."""
        drive = operations()
        play(drive.start(), [sent(0), sent(0x047C)])
        if running:
            play(drive.read("16-14"), [read()])
            play(drive.set_reference_percent(25), [sent(0), sent(0x043C, 4096)])
        else:
            with pytest.raises(StateError, match="would send the start again"):
                play(drive.set_reference_percent(25), [sent(0)])
            play(drive.set_reference_percent(25), [LOOK, sent(0x047C, 4096, RUNNING)])

    def test_a_reference_that_is_not_sent_is_not_remembered(self):
        drive = started()
        with pytest.raises(CommandTooOldError):
            play(drive.set_reference_percent(25), [LOOK, (sent(0x047C, 4096)[0], CommandTooOldError("old"))])
        repeats(drive, 0x047C, 0)


class TestFunctions:
    def test_jog_until_start_or_stop(self):
        drive = operations()
        play(drive.extra["jog"](), [sent(0), sent(0x057C)])
        repeats(drive, 0x057C)
        play(drive.start(), [LOOK, sent(0x047C)])

    def test_presets(self):
        drive = operations()
        play(drive.extra["select_preset"](2), [])
        play(drive.start(), [sent(0), sent(0x047D)])
        play(drive.extra["select_preset"](4), [LOOK, sent(0x047F, status=RUNNING)])
        play(drive.extra["select_preset"](1), [LOOK, sent(0x047C, status=RUNNING)])

    def test_ramp_2(self):
        drive = started()
        play(drive.extra["ramp"](2), [LOOK, sent(0x067C, status=RUNNING)])
        play(drive.stop(), [sent(0x063C)])
        play(drive.extra["ramp"](1), [])
        play(drive.start(), [sent(0), sent(0x047C)])

    def test_a_function_for_a_motor_that_has_stopped_waits_for_its_next_start(self):
        drive = started()
        play(drive.extra["ramp"](2), [sent(0)])
        play(drive.start(), [sent(0), sent(0x067C)])

    @pytest.mark.parametrize(("number", "word"), [(1, 0x047C), (2, 0x247C), (3, 0x447C), (4, 0x647C)])
    def test_set_ups(self, number, word):
        play(started().extra["select_setup"](number), [LOOK, sent(word, status=RUNNING)])

    def test_a_set_up_starts_no_motor_that_somebody_has_stopped(self):
        drive = started()
        with pytest.raises(StateError, match="select_setup needs a command that holds"):
            play(drive.extra["select_setup"](2), [sent(0)])
        play(drive.stop(), [sent(0x043C)])

    def test_relays_while_stopped(self):
        drive = operations()
        play(drive.stop(), [sent(0x043C)])
        play(drive.extra["set_relay"](2, True), [sent(0), sent(0x143C)])
        play(drive.extra["set_relay"](1, True), [sent(0), sent(0x1C3C)])
        play(drive.start(), [sent(0), sent(0x1C7C)])
        play(drive.stop(Stop.COAST), [sent(0x1C74)])
        play(drive.extra["set_relay"](1, False), [sent(0), sent(0x1474)])
        play(drive.extra["set_relay"](2, False), [sent(0), sent(0x0474)])

    @pytest.mark.parametrize(
        "call", [lambda drive: drive.extra["select_setup"](2), lambda drive: drive.extra["set_relay"](1, True)]
    )
    def test_what_acts_at_once_needs_a_valid_word(self, call):
        with pytest.raises(UsageError, match=r"start\(\) or stop\(\)"):
            play(call(operations()), [])

    def test_what_is_not_answered_leaves_nothing_behind(self):
        drive = operations()
        play(drive.stop(), [sent(0x043C)])
        with pytest.raises(NoReplyError):
            play(drive.extra["set_relay"](1, True), [sent(0), unanswered(0x0C3C)])
        play(drive.start(), [sent(0), sent(0x047C)])

    def test_hold(self):
        drive = started()
        play(drive.extra["hold"](), [LOOK, sent(0x045C, status=RUNNING)])
        repeats(drive, 0x045C)
        play(drive.start(), [LOOK, sent(0x047C)])

    def test_hold_is_for_a_running_motor(self):
        with pytest.raises(UsageError, match="hold"):
            play(operations().extra["hold"](), [])
        with pytest.raises(StateError, match="hold would send the start again"):
            play(started().extra["hold"](), [sent(0)])

    def test_a_control_word_is_repeated_without_its_edges(self):
        drive = operations()
        play(drive.extra["control_word"](0x2CFC), [sent(0x2CFC)])
        repeats(drive, 0x2C7C)
        play(drive.stop(), [sent(0x2C3C)])
        play(drive.extra["control_word"](0), [sent(0)])
        repeats_nothing(drive)

    def test_a_word_that_commands_nothing_carries_no_reference(self):
        play(started(reference=4096).extra["control_word"](0), [sent(0)])

    def test_a_control_word_that_runs_is_not_repeated_unless_it_was_answered(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.extra["control_word"](0x047C), [unanswered(0x047C)])
        repeats_nothing(drive)

    def test_release(self):
        drive = started()
        play(drive.extra["release"](), [])
        repeats_nothing(drive)

    @pytest.mark.parametrize(
        "call",
        [
            lambda drive: drive.extra["jog"](2),
            lambda drive: drive.extra["select_preset"](0),
            lambda drive: drive.extra["select_preset"](5),
            lambda drive: drive.extra["select_setup"](5),
            lambda drive: drive.extra["ramp"](3),
            lambda drive: drive.extra["control_word"](0x10000),
            lambda drive: drive.extra["control_word"]("047C"),
        ],
    )
    def test_what_does_not_exist(self, call):
        with pytest.raises(ValueRefusedError, match="does not exist"):
            call(operations())

    def test_relays_are_numbered(self):
        with pytest.raises(UsageError, match="relay"):
            operations().extra["set_relay"](3, True)

    @pytest.mark.parametrize("verb", ["catch_up", "slow_down"])
    def test_catching_up_is_profidrive(self, verb):
        with pytest.raises(NotSupported, match="PROFIdrive"):
            operations().extra[verb]()

    def test_every_function_can_be_reached(self):
        assert set(operations().extra) == {
            "jog",
            "ramp",
            "catch_up",
            "slow_down",
            "control_word",
            "release",
            "hold",
            "select_setup",
            "select_preset",
            "set_relay",
            "describe",
        }


class TestProfidrive:
    def test_two_steps(self):
        play(operations(profile="profidrive").start(reverse=True), [sent(0), sent(0x047E), sent(0x847F)])

    def test_a_running_drive_is_not_switched_off_to_be_started(self):
        drive = started("profidrive")
        play(drive.start(reverse=True), [LOOK, sent(0x847F)])

    def test_a_second_step_that_gets_lost_leaves_the_drive_off(self):
        drive = operations(profile="profidrive")
        with pytest.raises(NoReplyError):
            play(drive.start(), [sent(0), sent(0x047E), unanswered(0x047F)])
        repeats(drive, 0x047E, status=READY)

    @pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, 0x043F), (Stop.COAST, 0x0477), (Stop.QUICK, 0x046F)])
    def test_stops(self, how, word):
        play(started("profidrive").stop(how), [sent(word)])

    def test_there_is_no_dc_brake(self):
        drive = operations(profile="profidrive")
        assert Stop.DC_BRAKE not in drive.capabilities.stops
        with pytest.raises(NotSupported, match="dc_brake"):
            next(drive.stop(Stop.DC_BRAKE))

    def test_reset(self):
        script = [sent(0, status=TRIPPED), sent(0x043E, status=TRIPPED), sent(0x04BE, status=TRIPPED), sent(0x043E)]
        play(operations(profile="profidrive").reset(), script)

    def test_after_a_trip_a_stop_is_repeated_in_its_place(self):
        drive = started("profidrive")
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043E, status=READY)

    def test_start_not_possible_is_no_trip(self):
        assert play(started("profidrive").status(), [sent(0, status=0x0647)]).fault is False

    def test_jogs(self):
        drive = operations(profile="profidrive")
        play(drive.extra["jog"](2), [sent(0), sent(0x047E), sent(0x067F)])
        play(drive.extra["jog"](1), [LOOK, sent(0x057F)])

    def test_relative_commands_are_sent_once_and_forgotten(self):
        drive = started("profidrive")
        for verb, word in ((drive.extra["catch_up"], 0x147F), (drive.extra["slow_down"], 0x0C7F)):
            play(verb(), [LOOK, sent(word, status=RUNNING), sent(0x047F, status=RUNNING)])
        exchange = drive.extra["catch_up"]()
        next(exchange)
        assert exchange.send(LOOK[1]).attempts == 1
        with pytest.raises(UsageError, match="catch_up"):
            play(operations(profile="profidrive").extra["catch_up"](), [])

    def test_select_setup_hold_and_control_word(self):
        drive = started("profidrive")
        play(drive.extra["select_setup"](3), [LOOK, sent(0x447F, status=RUNNING)])
        play(drive.extra["hold"](), [LOOK, sent(0x445F, status=RUNNING)])
        play(drive.extra["control_word"](0x14FF), [sent(0x14FF)])
        repeats(drive, 0x047F)

    @pytest.mark.parametrize(
        "call",
        [
            lambda drive: drive.extra["select_preset"](1),
            lambda drive: drive.extra["ramp"](2),
            lambda drive: drive.extra["set_relay"](1, True),
        ],
    )
    def test_what_its_word_has_no_bits_for(self, call):
        with pytest.raises(NotSupported, match="PROFIdrive"):
            call(operations(profile="profidrive"))


class TestStatus:
    @pytest.mark.parametrize(
        ("word", "state"),
        [
            (0x0607, DriveState.READY),
            (0x0F07, DriveState.RUNNING),
            (0x0F03, DriveState.RUNNING),
            (0x0603, DriveState.NOT_READY),
            (0x0600, DriveState.NOT_READY),
            (0x0608, DriveState.FAULT),
            (0x0648, DriveState.FAULT),
        ],
    )
    def test_states(self, word, state):
        assert play(operations().status(), [sent(0, status=word)]).state is state

    def test_what_the_word_says(self):
        status = play(operations().status(), [sent(0, status=0x0F87, actual=-8192)])
        assert (status.word, status.running, status.warning, status.at_reference) == (0x0F87, True, True, True)
        assert (status.remote, status.fault, status.reverse) == (True, False, True)
        assert (status.actual_percent, status.actual_hz) == (-50, None)
        assert "speed equals reference" in status.flags

    def test_hertz_of_the_reference_range(self):
        drive = operations(reference_minimum_hz=10, reference_maximum_hz=50)
        status = play(drive.status(), [sent(0, status=RUNNING, actual=8192)])
        assert (status.actual_percent, status.actual_hz) == (50, 30)
        assert play(drive.status(), [sent(0, status=RUNNING, actual=-8192)]).actual_hz is None

    def test_hertz_of_the_frequency_limits(self):
        drive = operations(actual_scaling="limits", output_maximum_hz=50)
        status = play(drive.status(), [sent(0, status=RUNNING, actual=0x2000)])
        assert (status.actual_percent, status.actual_hz) == (None, 25)

    def test_the_code_of_a_fault(self):
        parameter = {"pnu": 1530, "ind": 0}
        request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
        reply = ParameterReply(**AT_3, **parameter, ak=1, pwe=14, status_word=TRIPPED, main_actual=0)
        status = play(operations(FC300).status(), [sent(0, status=TRIPPED), (request, reply)])
        assert (status.fault_code, status.fault_text) == (14, "earth fault")

    @pytest.mark.parametrize("ak", [7, 0])
    def test_a_drive_that_does_not_tell_the_code(self, ak):
        parameter = {"pnu": 1530, "ind": 0}
        request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
        reply = ParameterReply(**AT_3, **parameter, ak=ak, pwe=0, status_word=TRIPPED, main_actual=0)
        status = play(operations(FC300).status(), [sent(0, status=TRIPPED), (request, reply)])
        assert (status.fault, status.fault_code) == (True, None)

    def test_without_a_model_the_code_is_not_asked_for(self):
        assert play(operations().status(), [sent(0, status=TRIPPED)]).fault_code is None


def test_what_the_drive_can_be_asked_to_do():
    capabilities = operations().capabilities
    assert capabilities.stops == frozenset(Stop)
    assert capabilities.reverse
    assert capabilities.stored_writes
    assert capabilities.volatile_writes


def test_a_reset_does_not_bring_back_a_command_that_its_status_contradicts():
    """Somebody else has started the motor meanwhile: the word of the reset does not hold, and is not repeated."""
    memory = CommandMemory()
    steps = [sent(0, status=TRIPPED), sent(0x043C, status=TRIPPED)]
    play(operations(memory=memory).reset(), [*steps, sent(0x04BC, status=RUNNING), sent(0x043C, status=RUNNING)])
    assert memory.word == 0


def test_a_late_reply_to_a_start_confirms_no_stop():
    """Replies to process blocks all look alike."""
    virtual = virtual_drive("danfoss-fc", 3)
    line = VirtualLine([virtual])
    reply = ProcessReply(address_format="1-126", address=3, status_word=0x0F07, main_actual=0)

    def cut_off(event):
        if event.what == "sent" and event.message.control_word == 0x047C:
            line.power_off(virtual)

    with drivecomm.open_bus(line.port, trace=cut_off) as bus:
        drive = bus.drive("danfoss-fc", 3)
        drive.set_reference(percent=50)
        with pytest.raises(NoReplyError, match="whether the drive acted on it is not known"):
            drive.start()
        line.call_at(line.time + 0.03, lambda: line.inject(virtual.codec.encode(reply)))
        with pytest.raises(NoReplyError):
            drive.stop()
