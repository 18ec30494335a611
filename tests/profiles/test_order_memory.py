"""What is remembered of a drive whose commands are registers."""

import pytest

from drivecomm.profiles import OrderMemory, Step

START = Step(place="1", word=1)


@pytest.fixture
def memory():
    held = OrderMemory()
    held.hold(START, runs=True)
    return held


def test_a_trip_ends_a_start_also_before_the_motor_was_seen_to_run(memory):
    memory.notice(running=False, fault=True)
    assert memory.held is None


def test_a_start_holds_until_the_motor_is_seen_to_stand_after_it_ran(memory):
    memory.notice(running=False, fault=False)
    assert memory.held is START
    memory.notice(running=True, fault=False)
    assert memory.held is START
    memory.notice(running=False, fault=False)
    assert memory.held is None


def test_what_lets_no_motor_run_holds_over_a_trip(memory):
    memory.hold(START, runs=False)
    memory.notice(running=False, fault=True)
    assert memory.held is START


def test_whether_the_drive_has_answered_is_not_forgotten_with_its_command(memory):
    memory.unanswered = True
    memory.forget()
    assert (memory.held, memory.unanswered) == (None, True)
