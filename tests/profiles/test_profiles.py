"""Each control profile: free of mistakes, and obeyed by its own machine in every command that it offers."""

import pytest
from played import Drive

from drivecomm.errors import NoReplyError, NotSupported, StateError
from drivecomm.profiles import Commander, control_profile, control_profiles, mistakes_in, taken_over
from drivecomm.protocol import DriveState, Stop

ALL = [control_profile(name) for name in control_profiles()]
ACTED = [each for each in ALL if each.transitions]

by_name = pytest.mark.parametrize("known", ACTED, ids=lambda known: known.name)


def commander(drive, **further):
    return Commander(drive.profile, drive, state_timeout_s=1.0, **further)


def started(known, **options):
    drive = Drive(known, **options)
    drive.carry_out(commander(drive).start())
    return drive


def state(drive):
    return drive.profile.status(drive.words()).state


@pytest.mark.parametrize("known", ALL, ids=lambda known: known.name)
def test_packaged_profile_has_no_mistakes_and_a_source(known):
    assert list(mistakes_in(known)) == []
    assert known.source


@by_name
def test_start_leads_to_a_running_motor(known):
    drive = started(known)
    assert drive.motor.running
    assert state(drive) is DriveState.RUNNING
    drive.passes(5)
    assert drive.motor.output_hz == 50


@by_name
def test_reverse_bit_turns_the_motor_backwards_and_is_in_running_words_only(known):
    if known.reverse:
        drive = Drive(known)
        drive.carry_out(commander(drive).start(reverse=True))
        drive.passes(5)
        assert drive.motor.output_hz == -50
        assert all(bool(word & known.reverse) is known.lets_run(word) for word, _ in drive.sent)
        if not known.start_reverse:
            assert [word & ~known.reverse for word, _ in drive.sent] == [step.word for step in known.start]


@by_name
def test_reverse_start_with_its_own_steps_runs_the_motor_backwards(known):
    if known.start_reverse:
        drive = Drive(known)
        drive.carry_out(commander(drive).start(reverse=True))
        assert drive.motor.running
        assert known.says("reverse", drive.words()) is True
        assert [word for word, _ in drive.sent] == [step.word for step in known.start_reverse]
        drive.carry_out(commander(drive).start())
        assert known.says("reverse", drive.words()) is False


@by_name
def test_each_step_sets_all_bits_that_let_a_motor_run(known):
    ways = (known.start, known.start_reverse, known.reset, *known.stops.values())
    assert all(known.runs.mask & ~step.mask == 0 for steps in ways for step in steps)


@by_name
def test_motor_runs_only_after_the_last_word_of_the_start(known):
    drive = Drive(known)
    for step in known.start[:-1]:
        drive.machine.control(step.word, drive.now)
        assert not drive.motor.running
        assert not known.lets_run(step.word)
    assert known.lets_run(known.start[-1].word)


@by_name
@pytest.mark.parametrize("how", list(Stop))
def test_each_stop_is_urgent_and_leaves_the_motor_stopped(known, how):
    drive = started(known)
    drive.passes(5)
    sent = len(drive.sent)
    if how not in known.stops:
        with pytest.raises(NotSupported):
            drive.carry_out(commander(drive).stop(how))
        assert len(drive.sent) == sent
        return
    drive.carry_out(commander(drive).stop(how))
    assert all(urgent for _, urgent in drive.sent[sent:])
    assert how is not Stop.COAST or not drive.motor.running
    drive.passes(5)
    assert not drive.motor.running
    drive.passes(60)
    assert not drive.motor.running


@by_name
def test_quick_stop_is_quicker_than_a_ramp_stop(known):
    if Stop.QUICK not in known.stops:
        pytest.skip("it has no quick stop")
    stands = {}
    for how in (Stop.RAMP, Stop.QUICK):
        drive = started(known)
        drive.passes(5)
        drive.carry_out(commander(drive).stop(how))
        drive.passes(0.5)
        stands[how] = not drive.motor.running
    assert stands == {Stop.RAMP: False, Stop.QUICK: True}


@by_name
@pytest.mark.parametrize("how", list(Stop))
def test_motor_can_be_started_again_after_each_stop(known, how):
    if how in known.stops:
        drive = started(known)
        drive.carry_out(commander(drive).stop(how))
        drive.passes(5)
        drive.carry_out(commander(drive).start())
        assert drive.motor.running


@by_name
def test_start_that_is_not_obeyed_is_taken_back(known):
    # The status word of the FC profile shows "running" only when the motor turns, and a start at 0 Hz turns no motor.
    if known.start[-1].until:
        drive = Drive(known, deaf_to=known.start[-1].word)
        with pytest.raises(StateError, match="taken back"):
            drive.carry_out(commander(drive, advice="its inputs").start())
        assert drive.sent[-1] == (known.take_back[-1].word, True)
        assert sum(known.lets_run(word) for word, _ in drive.sent) <= 1


@by_name
def test_unanswered_start_is_sent_once_and_raises_an_error(known):
    drive = Drive(known)
    for step in known.start[:-1]:
        drive.machine.control(step.word, drive.now)
    drive.sent.clear()
    drive.lost = len(known.start)
    with pytest.raises(NoReplyError):
        drive.carry_out(commander(drive).start())
    assert sum(known.lets_run(word) for word, _ in drive.sent) <= 1


@by_name
def test_start_in_a_fault_is_refused_and_reset_sends_one_edge(known):
    drive = started(known)
    drive.machine.trip(7, drive.now)
    assert state(drive) is DriveState.FAULT
    sent = len(drive.sent)
    with pytest.raises(StateError, match="reset it first"):
        drive.carry_out(commander(drive).start())
    assert len(drive.sent) == sent
    drive.carry_out(commander(drive).reset())
    assert not drive.motor.fault
    assert not drive.motor.running
    words = [word for word, _ in drive.sent[sent:]]
    edges = {word for word in words if words.count(word) == 1}
    assert edges
    assert not any(known.lets_run(word) for word in words)
    drive.passes(60)
    assert not drive.motor.running


@by_name
def test_reset_needs_a_rising_edge(known):
    drive = started(known)
    edge = known.reset[1].word
    drive.machine.trip(7, drive.now)
    drive.machine.word = edge
    drive.machine.control(edge, drive.now)
    assert drive.motor.fault


@by_name
def test_reset_of_a_drive_without_a_fault_sends_nothing(known):
    drive = started(known)
    sent = len(drive.sent)
    drive.carry_out(commander(drive).reset())
    assert len(drive.sent) == sent
    assert drive.motor.running


@by_name
def test_reset_of_a_lasting_fault_raises_an_error(known):
    drive = started(known)
    drive.machine.trip(7, drive.now)
    drive.deaf = True
    with pytest.raises(StateError, match="still tripped after the reset"):
        drive.carry_out(commander(drive).reset())


@by_name
def test_idle_word_changes_neither_state_nor_motor(known):
    if known.idle is not None:
        drive = started(known)
        before = drive.machine.state, drive.motor.command
        drive.machine.control(known.idle, drive.now)
        assert (drive.machine.state, drive.motor.command) == before
        assert not known.commands(known.idle)


@by_name
def test_motor_stays_stopped_after_power_up(known):
    drive = started(known)
    drive.machine.power_up(drive.now)
    drive.passes(60)
    assert not drive.motor.running


@by_name
def test_no_single_word_starts_a_drive_after_power_up_or_reset(known):
    if len(known.start) > 1:
        for tripped in (False, True):
            drive = Drive(known)
            if tripped:
                drive = started(known)
                drive.machine.trip(7, drive.now)
                drive.carry_out(commander(drive).reset())
                drive.machine.power_up(drive.now)
            drive.machine.control(known.start[-1].word, drive.now)
            assert not drive.motor.running


@by_name
def test_each_state_is_reported_with_its_meaning(known):
    for each in known.states:
        assert known.status({"": each.shows}).state is each.means


def test_reference_taken_over_from_a_drive_is_signed():
    assert [taken_over(raw) for raw in (0x0000, 0x7FFF, 0x8000, 0xC000)] == [0, 32767, -32768, -16384]
    with pytest.raises(StateError, match="set the reference first"):
        taken_over(None)
