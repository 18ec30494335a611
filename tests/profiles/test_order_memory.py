"""Remembered commands of a drive that is commanded by registers."""

import pytest

from drivecomm.profiles import OrderMemory, Step

START = Step(place="1", word=1)


@pytest.fixture
def memory():
    held = OrderMemory()
    held.hold(START, runs=True)
    return held


def test_trip_clears_a_start_even_if_the_motor_was_never_seen_running(memory):
    memory.notice(running=False, fault=True)
    assert memory.held is None


def test_start_is_held_until_the_motor_stops_after_running(memory):
    memory.notice(running=False, fault=False)
    assert memory.held is START
    memory.notice(running=True, fault=False)
    assert memory.held is START
    memory.notice(running=False, fault=False)
    assert memory.held is None


def test_command_that_runs_no_motor_is_held_through_a_trip(memory):
    memory.hold(START, runs=False)
    memory.notice(running=False, fault=True)
    assert memory.held is START


def test_forget_keeps_the_unanswered_mark(memory):
    memory.unanswered = True
    memory.forget()
    assert (memory.held, memory.unanswered) == (None, True)
