"""Events of a drive that is observed again and again."""

from dataclasses import replace
from itertools import pairwise

from plants import PUMP

from drivecomm.plant.watching.board import DriveView, changes
from drivecomm.protocol import DriveState, DriveStatus

READY = DriveStatus(word=0, state=DriveState.READY, running=False, fault=False, warning=False)
WARNED = replace(READY, warning=True)
RUNNING = replace(READY, state=DriveState.RUNNING, running=True, reverse=False)
SILENCE = object()
"""The drive does not answer."""
VALUE = object()
"""The drive answers a request for a value, and its status has not been read yet."""


def told(*course):
    """Return the events of a drive observed in these steps: statuses, some with a fault, values, and silences."""
    views = [DriveView(drive=PUMP, line="hall")]
    for step in course:
        last = views[-1]
        if step is SILENCE:
            views.append(last.silent("gone"))
        elif step is VALUE:
            views.append(replace(last, reachability="answers"))
        else:
            status, fault = step if isinstance(step, tuple) else (step, "")
            views.append(replace(last, reachability="answers").with_status(status, fault))
    return [(event.kind, event.text) for before, after in pairwise(views) for event in changes(before, after, 1.0)]


def test_warning_is_reported_when_it_appears():
    assert told(READY, WARNED, WARNED, READY, WARNED) == [("warning", "warning")] * 2
    assert told(WARNED) == [("warning", "warning")]


def test_state_is_reported_when_it_changes():
    assert told(READY, RUNNING, RUNNING, replace(RUNNING, reverse=True)) == [
        ("change", "running"),
        ("change", "running backwards"),
    ]


def test_first_state_is_not_reported():
    assert told(RUNNING) == []


def test_fault_is_reported_when_it_appears_changes_and_ends():
    assert told(READY, (READY, "5"), (READY, "5"), (READY, "14"), READY) == [
        ("fault", "fault: 5"),
        ("fault", "fault: 14"),
        ("change", "the fault is gone"),
    ]


GAP = [("silent", "gone"), ("change", "answers again")]


def test_changes_during_a_silence_are_reported_with_the_next_status():
    assert told(RUNNING, SILENCE, VALUE, READY) == [*GAP, ("change", "ready")]
    assert told((READY, "5"), SILENCE, READY)[1:] == [*GAP, ("change", "the fault is gone")]
    assert told((READY, "5"), SILENCE, (READY, "14"))[1:] == [*GAP, ("fault", "fault: 14")]


def test_condition_that_lasts_through_a_silence_is_reported_once():
    assert told((READY, "5"), SILENCE, VALUE, (READY, "5"))[1:] == GAP
    assert told(WARNED, SILENCE, WARNED)[1:] == GAP
    assert told(RUNNING, SILENCE, RUNNING) == GAP


def test_status_is_unknown_after_a_silence_until_it_is_read_again():
    seen = DriveView(drive=PUMP, line="hall", reachability="answers").with_status(RUNNING, "5")
    after = replace(seen.silent("gone"), reachability="answers")
    assert (after.status, after.fault) == (None, "")
    assert (after.last_status, after.last_fault) == (RUNNING, "5")
