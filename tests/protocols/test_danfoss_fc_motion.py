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
    """Return the operations of a master that has set a reference and knows that the watchdog of the drive is on."""
    if memory is None:
        memory = CommandMemory()
        memory.reference = reference
        memory.watch(5.0)
    options = {**(model.options if model else {}), "control_word_parameter": "", **options}
    return DanfossFcOperations(3, DanfossFcOptions(**options), model, memory)


def sent(word, reference=0, status=READY, actual=0):
    """Return a process block and its reply, for the script."""
    request = ProcessRequest(**AT_3, control_word=word, reference=reference)
    return request, ProcessReply(**AT_3, status_word=status, main_actual=actual)


def unanswered(word, reference=0):
    return sent(word, reference)[0], NoReplyError("silence")


LOOK = sent(0, status=RUNNING)
"""A status request to a running motor: a process block that commands nothing, and its reply."""


def read(status=RUNNING):
    """Return a read of 16-14 and its reply; a read carries no control word, whatever was commanded."""
    parameter = {"pnu": 1614, "ind": 0}
    request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
    return request, ParameterReply(**AT_3, **parameter, ak=2, pwe=524, status_word=status, main_actual=0)


def started(profile="fc", reference=0, **options):
    """Return a master that has started the motor and has seen it run."""
    drive = operations(profile=profile, reference=reference, **options)
    steps = [sent(0x047E, reference), sent(0x047F, reference)] if profile == "profidrive" else [sent(0x047C, reference)]
    play(drive.start(), [sent(0), *steps])
    play(drive.read("16-14"), [read()])
    return drive


def repeats(drive, word, reference=0, status=RUNNING):
    """Play a call of status: it first requests the status, then repeats this word."""
    play(drive.status(), [sent(0, status=status), sent(word, reference, status)])


def repeats_nothing(drive, status=RUNNING):
    play(drive.status(), [sent(0, status=status)])


class TestWithoutAWatchdog:
    """Drives whose watchdog is off, so that no command has to be repeated."""

    def test_start_and_stop_are_not_repeated_without_a_watchdog(self):
        memory = CommandMemory()
        memory.reference = 0
        drive = operations(memory=memory)
        play(drive.start(), [sent(0), sent(0x047C)])
        repeats_nothing(drive)
        play(drive.stop(), [sent(0x043C, status=RUNNING)])
        repeats_nothing(drive)

    def test_start_is_taken_back_once_after_a_trip(self):
        """A tripped drive keeps the start, so a reset at its keypad would start the motor."""
        memory = CommandMemory()
        memory.reference = 0
        drive = operations(memory=memory)
        play(drive.start(), [sent(0), sent(0x047C)])
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043C, status=TRIPPED)
        repeats_nothing(drive, TRIPPED)

    def test_stop_is_not_repeated_if_another_master_has_restarted_the_motor(self):
        drive = started()
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats_nothing(drive, RUNNING)


def shows(word, status=RUNNING):
    return shown(1685, word, status)


class TestAnotherMaster:
    """A motor stopped by another master.

    It shows as running until it stands; the drive may show the control word that stopped it.
    """

    def test_stop_by_another_master_is_not_undone(self):
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
    def test_start_is_repeated_if_the_drive_shows_one_of_our_words_or_none(self, word):
        """Some drives may show the last word received, which is that of the status request; others show none."""
        drive = started(control_word_parameter="16-85")
        play(drive.status(), [LOOK, shows(word), sent(0x047C, status=RUNNING)])


class TestBeforeAnyCommand:
    def test_read_before_any_command_carries_no_control_word(self):
        play(operations().read("16-14"), [read()])

    def test_status_before_any_command_carries_no_control_word(self):
        repeats_nothing(operations())

    def test_reference_for_a_stopped_drive_carries_the_ramp_stop_word(self):
        drive = operations()
        play(drive.set_reference_percent(50), [sent(0), sent(0x043C, 8192)])
        repeats(drive, 0x043C, 8192, status=READY)
        play(drive.start(), [sent(0), sent(0x047C, 8192)])


def shown(pnu, value, status=READY):
    """Return a read of a parameter in which the drive shows a word that it has received, and its reply."""
    request = ParameterRequest(**AT_3, pnu=pnu, ind=0, ak=1, pwe=0, control_word=0, reference=0)
    refused = value is None
    reply = ParameterReply(
        **AT_3, pnu=pnu, ind=0, ak=7 if refused else 1, pwe=value or 0, status_word=status, main_actual=0
    )
    return request, reply


def fresh(**options):
    """Return a master that remembers nothing, as in each call of the command line."""
    return operations(memory=CommandMemory(), **options)


class TestTakingOver:
    def test_start_takes_over_the_reference_that_the_drive_shows(self):
        play(fresh().start(), [sent(0), shown(1686, 0xE000), sent(0x047C, -8192)])

    def test_start_without_a_known_reference_is_refused(self):
        with pytest.raises(StateError, match="no reference was set from here"):
            play(fresh().start(), [sent(0), shown(1686, None)])
        with pytest.raises(StateError, match="no reference was set from here"):
            play(fresh(reference_parameter="").start(), [sent(0)])

    def test_motor_started_by_another_program_is_sent_no_control_word(self):
        """The word that the drive shows may be outdated, since the other program may stop the motor meanwhile."""
        drive = fresh()
        with pytest.raises(StateError, match="came from another program"):
            play(drive.set_reference_percent(50), [LOOK])
        repeats_nothing(drive)
        play(drive.start(), [LOOK, shown(1686, 0x1000), sent(0x047C, 4096, RUNNING)])


class TestStart:
    def test_start_word_is_sent_once(self):
        exchange = operations().start()
        next(exchange)
        command = exchange.send(sent(0)[1])
        assert command.message.control_word == 0x047C
        assert (command.attempts, command.acts, command.command) == (1, True, "new")

    def test_start_is_repeated_by_status_while_the_motor_runs(self):
        drive = started()
        play(drive.set_reference_percent(100), [LOOK, sent(0x047C, 16384, RUNNING)])
        play(drive.read("16-14"), [read()])
        repeats(drive, 0x047C, 16384)

    def test_repeated_start_is_marked_as_repeated(self):
        exchange = started().status()
        assert next(exchange).command == ""
        again = exchange.send(LOOK[1])
        assert (again.command, again.acts, again.urgent) == ("repeated", False, False)

    def test_start_is_not_repeated_before_the_motor_was_seen_running(self):
        drive = operations()
        play(drive.start(), [sent(0), sent(0x047C)])
        repeats_nothing(drive, READY)
        repeats(drive, 0x047C)

    def test_start_is_forgotten_when_the_motor_is_seen_stopped(self):
        """The motor may have been stopped by its watchdog, by another master or by a mains dip."""
        for find_out in (lambda drive: drive.status(), lambda drive: drive.probe()):
            drive = started()
            play(find_out(drive), [sent(0, status=READY)])
            repeats_nothing(drive)
        drive = started()
        play(drive.read("16-14"), [read(READY)])
        repeats_nothing(drive)

    def test_status_succeeds_if_the_command_is_too_old_to_repeat(self):
        assert play(started().status(), [LOOK, (sent(0x047C)[0], CommandTooOldError("old"))]).running

    def test_reverse_start_sets_the_reverse_bit(self):
        play(operations().start(reverse=True), [sent(0), sent(0x847C)])

    @pytest.mark.parametrize(("status", "words"), [(TRIPPED, "tripped"), (LOCAL, "local"), (0x0640, "tripped")])
    def test_start_is_refused_unsent_if_the_drive_cannot_start(self, status, words):
        drive = operations()
        with pytest.raises(StateError, match=words):
            play(drive.start(), [sent(0, status=status)])
        repeats_nothing(drive)

    def test_start_without_a_reply_is_not_repeated(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.start(), [sent(0), unanswered(0x047C)])
        repeats_nothing(drive)

    def test_stop_is_repeated_in_place_of_the_start_after_a_trip(self):
        drive = started()
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043C, status=READY)


class TestStop:
    @pytest.mark.parametrize(
        ("how", "word"),
        [(Stop.RAMP, 0x043C), (Stop.COAST, 0x0474), (Stop.QUICK, 0x046C), (Stop.DC_BRAKE, 0x0478)],
    )
    def test_stop_sends_and_repeats_its_control_word(self, how, word):
        drive = started()
        play(drive.stop(how), [sent(word, status=RUNNING)])
        play(drive.read("16-14"), [read()])
        repeats(drive, word)

    def test_stop_without_a_reply_is_repeated_by_status(self):
        drive = started()
        with pytest.raises(NoReplyError):
            play(drive.stop(), [unanswered(0x043C)])
        repeats(drive, 0x043C)

    def test_stop_is_not_repeated_after_another_master_starts_the_motor(self):
        drive = started()
        play(drive.stop(), [sent(0x043C)])
        repeats(drive, 0x043C, status=READY)
        repeats_nothing(drive, RUNNING)

    def test_stop_in_local_operation_raises_state_error(self):
        with pytest.raises(StateError, match="local operation"):
            play(operations().stop(), [sent(0x043C, status=LOCAL)])

    def test_reference_after_a_stop_is_sent_with_the_stop_word(self):
        drive = started()
        play(drive.stop(), [sent(0x043C)])
        play(drive.set_reference_percent(25), [sent(0), sent(0x043C, 4096)])
        play(drive.start(), [sent(0), sent(0x047C, 4096)])


class TestReset:
    def test_reset_sends_the_edge_between_two_words_without_the_bit(self):
        script = [sent(0, status=TRIPPED), sent(0x043C, status=TRIPPED), sent(0x04BC, status=TRIPPED), sent(0x043C)]
        play(operations().reset(), script)

    def test_reset_edge_is_sent_once(self):
        exchange = operations().reset()
        next(exchange)
        exchange.send(sent(0, status=TRIPPED)[1])
        command = exchange.send(sent(0, status=TRIPPED)[1])
        assert command.message.control_word == 0x04BC
        assert (command.attempts, command.acts) == (1, True)

    def test_motor_stays_stopped_after_a_reset(self):
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

    def test_reset_without_a_trip_sends_no_control_word(self):
        drive = started()
        play(drive.reset(), [LOOK])
        repeats(drive, 0x047C)

    @pytest.mark.parametrize(("status", "words"), [(TRIPPED, "cause"), (TRIPPED | 0x40, "mains")])
    def test_reset_of_a_lasting_trip_raises_state_error(self, status, words):
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
    def test_reference_percent_is_sent_as_the_nearest_step(self, percent, steps):
        play(started().set_reference_percent(percent), [LOOK, sent(0x047C, steps, RUNNING)])

    @pytest.mark.parametrize("percent", [200, "-200.01", 10**9, "-1e30", "x", float("nan")])
    def test_reference_percent_outside_the_word_is_refused(self, percent):
        with pytest.raises(ValueRefusedError):
            operations().set_reference_percent(percent)

    def test_reference_in_hz_needs_the_reference_range(self):
        assert not operations().capabilities.reference_hz
        with pytest.raises(NotSupported, match="reference_maximum_hz"):
            operations().set_reference_hz(25)

    def test_reference_in_hz_is_scaled_to_the_reference_range(self):
        drive = started(reference_maximum_hz=50)
        assert drive.capabilities.reference_hz
        play(drive.set_reference_hz("25"), [LOOK, sent(0x047C, 8192, RUNNING)])
        play(drive.set_reference_hz(-50), [LOOK, sent(0x047C, -16384, RUNNING)])
        with pytest.raises(ValueRefusedError, match="outside"):
            drive.set_reference_hz(50.1)

    def test_reference_in_hz_counts_from_the_reference_minimum(self):
        drive = started(reference_minimum_hz=10, reference_maximum_hz=50)
        play(drive.set_reference_hz(30), [LOOK, sent(0x047C, 8192, RUNNING)])
        for beyond in (9, -30):
            with pytest.raises(ValueRefusedError):
                drive.set_reference_hz(beyond)

    def test_reference_without_a_reply_is_repeated_by_status(self):
        drive = started()
        with pytest.raises(NoReplyError):
            play(drive.set_reference_percent(25), [LOOK, unanswered(0x047C, 4096)])
        repeats(drive, 0x047C, 4096)

    @pytest.mark.parametrize("running", [True, False])
    def test_reference_does_not_restart_a_stopped_motor(self, running):
        """running: whether the motor was seen running since its start."""
        drive = operations()
        play(drive.start(), [sent(0), sent(0x047C)])
        if running:
            play(drive.read("16-14"), [read()])
            play(drive.set_reference_percent(25), [sent(0), sent(0x043C, 4096)])
        else:
            with pytest.raises(StateError, match="would send the start again"):
                play(drive.set_reference_percent(25), [sent(0)])
            play(drive.set_reference_percent(25), [LOOK, sent(0x047C, 4096, RUNNING)])

    def test_reference_that_is_too_old_to_send_is_not_remembered(self):
        drive = started()
        with pytest.raises(CommandTooOldError):
            play(drive.set_reference_percent(25), [LOOK, (sent(0x047C, 4096)[0], CommandTooOldError("old"))])
        repeats(drive, 0x047C, 0)


class TestFunctions:
    def test_jog_is_repeated_until_a_start(self):
        drive = operations()
        play(drive.extra["jog"](), [sent(0), sent(0x057C)])
        repeats(drive, 0x057C)
        play(drive.start(), [LOOK, sent(0x047C)])

    def test_preset_is_part_of_the_next_start_word_and_changes_while_running(self):
        drive = operations()
        play(drive.extra["select_preset"](2), [])
        play(drive.start(), [sent(0), sent(0x047D)])
        play(drive.extra["select_preset"](4), [LOOK, sent(0x047F, status=RUNNING)])
        play(drive.extra["select_preset"](1), [LOOK, sent(0x047C, status=RUNNING)])

    def test_ramp_selection_is_part_of_each_control_word(self):
        drive = started()
        play(drive.extra["ramp"](2), [LOOK, sent(0x067C, status=RUNNING)])
        play(drive.stop(), [sent(0x063C)])
        play(drive.extra["ramp"](1), [])
        play(drive.start(), [sent(0), sent(0x047C)])

    def test_ramp_selection_for_a_stopped_motor_waits_for_the_next_start(self):
        drive = started()
        play(drive.extra["ramp"](2), [sent(0)])
        play(drive.start(), [sent(0), sent(0x067C)])

    @pytest.mark.parametrize(("number", "word"), [(1, 0x047C), (2, 0x247C), (3, 0x447C), (4, 0x647C)])
    def test_select_setup_sets_the_set_up_bits(self, number, word):
        play(started().extra["select_setup"](number), [LOOK, sent(word, status=RUNNING)])

    def test_select_setup_does_not_restart_a_motor_stopped_by_others(self):
        drive = started()
        with pytest.raises(StateError, match="select_setup needs an active command"):
            play(drive.extra["select_setup"](2), [sent(0)])
        play(drive.stop(), [sent(0x043C)])

    def test_relay_bits_are_kept_in_each_control_word(self):
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
    def test_set_up_and_relay_need_an_earlier_start_or_stop(self, call):
        with pytest.raises(UsageError, match=r"start\(\) or stop\(\)"):
            play(call(operations()), [])

    def test_relay_without_a_reply_is_not_remembered(self):
        drive = operations()
        play(drive.stop(), [sent(0x043C)])
        with pytest.raises(NoReplyError):
            play(drive.extra["set_relay"](1, True), [sent(0), unanswered(0x0C3C)])
        play(drive.start(), [sent(0), sent(0x047C)])

    def test_hold_is_sent_and_repeated_until_a_start(self):
        drive = started()
        play(drive.extra["hold"](), [LOOK, sent(0x045C, status=RUNNING)])
        repeats(drive, 0x045C)
        play(drive.start(), [LOOK, sent(0x047C)])

    def test_hold_of_a_stopped_motor_is_refused(self):
        with pytest.raises(UsageError, match="hold"):
            play(operations().extra["hold"](), [])
        with pytest.raises(StateError, match="hold would send the start again"):
            play(started().extra["hold"](), [sent(0)])

    def test_raw_control_word_is_repeated_without_its_edge_bits(self):
        drive = operations()
        play(drive.extra["control_word"](0x2CFC), [sent(0x2CFC)])
        repeats(drive, 0x2C7C)
        play(drive.stop(), [sent(0x2C3C)])
        play(drive.extra["control_word"](0), [sent(0)])
        repeats_nothing(drive)

    def test_control_word_zero_carries_no_reference(self):
        play(started(reference=4096).extra["control_word"](0), [sent(0)])

    def test_unanswered_running_control_word_is_not_repeated(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.extra["control_word"](0x047C), [unanswered(0x047C)])
        repeats_nothing(drive)

    def test_release_ends_the_repetition_of_commands(self):
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
    def test_invalid_number_of_a_function_is_refused(self, call):
        with pytest.raises(ValueRefusedError, match="does not exist"):
            call(operations())

    def test_relay_3_is_refused(self):
        with pytest.raises(UsageError, match="relay"):
            operations().extra["set_relay"](3, True)

    @pytest.mark.parametrize("verb", ["catch_up", "slow_down"])
    def test_catch_up_and_slow_down_need_the_profidrive_profile(self, verb):
        with pytest.raises(NotSupported, match="PROFIdrive"):
            operations().extra[verb]()

    def test_extra_lists_every_function(self):
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
    def test_profidrive_start_takes_two_steps(self):
        play(operations(profile="profidrive").start(reverse=True), [sent(0), sent(0x047E), sent(0x847F)])

    def test_profidrive_start_of_a_running_drive_skips_the_first_step(self):
        drive = started("profidrive")
        play(drive.start(reverse=True), [LOOK, sent(0x847F)])

    def test_profidrive_start_with_a_lost_second_step_repeats_the_first(self):
        drive = operations(profile="profidrive")
        with pytest.raises(NoReplyError):
            play(drive.start(), [sent(0), sent(0x047E), unanswered(0x047F)])
        repeats(drive, 0x047E, status=READY)

    @pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, 0x043F), (Stop.COAST, 0x0477), (Stop.QUICK, 0x046F)])
    def test_profidrive_stop_sends_its_control_word(self, how, word):
        play(started("profidrive").stop(how), [sent(word)])

    def test_profidrive_has_no_dc_brake(self):
        drive = operations(profile="profidrive")
        assert Stop.DC_BRAKE not in drive.capabilities.stops
        with pytest.raises(NotSupported, match="dc_brake"):
            next(drive.stop(Stop.DC_BRAKE))

    def test_profidrive_reset_sends_the_edge_between_two_words(self):
        script = [sent(0, status=TRIPPED), sent(0x043E, status=TRIPPED), sent(0x04BE, status=TRIPPED), sent(0x043E)]
        play(operations(profile="profidrive").reset(), script)

    def test_profidrive_stop_is_repeated_after_a_trip(self):
        drive = started("profidrive")
        play(drive.read("16-14"), [read(TRIPPED)])
        repeats(drive, 0x043E, status=READY)

    def test_profidrive_start_not_possible_is_not_a_fault(self):
        assert play(started("profidrive").status(), [sent(0, status=0x0647)]).fault is False

    def test_profidrive_jog_takes_two_steps(self):
        drive = operations(profile="profidrive")
        play(drive.extra["jog"](2), [sent(0), sent(0x047E), sent(0x067F)])
        play(drive.extra["jog"](1), [LOOK, sent(0x057F)])

    def test_catch_up_and_slow_down_are_sent_once_and_not_repeated(self):
        drive = started("profidrive")
        for verb, word in ((drive.extra["catch_up"], 0x147F), (drive.extra["slow_down"], 0x0C7F)):
            play(verb(), [LOOK, sent(word, status=RUNNING), sent(0x047F, status=RUNNING)])
        exchange = drive.extra["catch_up"]()
        next(exchange)
        assert exchange.send(LOOK[1]).attempts == 1
        with pytest.raises(UsageError, match="catch_up"):
            play(operations(profile="profidrive").extra["catch_up"](), [])

    def test_profidrive_functions_set_their_bits(self):
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
    def test_function_without_a_profidrive_bit_is_refused(self, call):
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
    def test_status_word_gives_the_drive_state(self, word, state):
        assert play(operations().status(), [sent(0, status=word)]).state is state

    def test_status_reports_the_bits_of_the_status_word(self):
        status = play(operations().status(), [sent(0, status=0x0F87, actual=-8192)])
        assert (status.word, status.running, status.warning, status.at_reference) == (0x0F87, True, True, True)
        assert (status.remote, status.fault, status.reverse) == (True, False, True)
        assert (status.actual_percent, status.actual_hz) == (-50, None)
        assert "speed equals reference" in status.flags

    def test_actual_hz_follows_the_reference_range(self):
        drive = operations(reference_minimum_hz=10, reference_maximum_hz=50)
        status = play(drive.status(), [sent(0, status=RUNNING, actual=8192)])
        assert (status.actual_percent, status.actual_hz) == (50, 30)
        assert play(drive.status(), [sent(0, status=RUNNING, actual=-8192)]).actual_hz is None

    def test_actual_hz_follows_the_frequency_limits(self):
        drive = operations(actual_scaling="limits", output_maximum_hz=50)
        status = play(drive.status(), [sent(0, status=RUNNING, actual=0x2000)])
        assert (status.actual_percent, status.actual_hz) == (None, 25)

    def test_status_of_a_trip_has_fault_code_and_text(self):
        parameter = {"pnu": 1530, "ind": 0}
        request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
        reply = ParameterReply(**AT_3, **parameter, ak=1, pwe=14, status_word=TRIPPED, main_actual=0)
        status = play(operations(FC300).status(), [sent(0, status=TRIPPED), (request, reply)])
        assert (status.fault_code, status.fault_text) == (14, "earth fault")

    @pytest.mark.parametrize("ak", [7, 0])
    def test_status_of_a_trip_without_a_readable_code_has_none(self, ak):
        parameter = {"pnu": 1530, "ind": 0}
        request = ParameterRequest(**AT_3, **parameter, ak=1, pwe=0, control_word=0, reference=0)
        reply = ParameterReply(**AT_3, **parameter, ak=ak, pwe=0, status_word=TRIPPED, main_actual=0)
        status = play(operations(FC300).status(), [sent(0, status=TRIPPED), (request, reply)])
        assert (status.fault, status.fault_code) == (True, None)

    def test_status_without_a_model_does_not_read_the_fault_code(self):
        assert play(operations().status(), [sent(0, status=TRIPPED)]).fault_code is None


def test_capabilities_list_stops_reverse_and_writes():
    capabilities = operations().capabilities
    assert capabilities.stops == frozenset(Stop)
    assert capabilities.reverse
    assert capabilities.stored_writes
    assert capabilities.volatile_writes


def test_reset_word_is_not_held_if_the_motor_runs_meanwhile():
    """Another master has started the motor during the reset, so the word of the reset must not be repeated."""
    memory = CommandMemory()
    steps = [sent(0, status=TRIPPED), sent(0x043C, status=TRIPPED)]
    play(operations(memory=memory).reset(), [*steps, sent(0x04BC, status=RUNNING), sent(0x043C, status=RUNNING)])
    assert memory.word == 0


def test_late_reply_to_a_start_does_not_confirm_a_stop():
    """All replies to process blocks look alike."""
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
