"""What is told of a drive that is looked at again and again."""

from dataclasses import replace
from itertools import pairwise

from plants import PUMP

from drivecomm.plant.watching.board import DriveView, changes
from drivecomm.protocol import DriveState, DriveStatus

READY = DriveStatus(word=0, state=DriveState.READY, running=False, fault=False, warning=False)
WARNED = replace(READY, warning=True)
RUNNING = replace(READY, state=DriveState.RUNNING, running=True, reverse=False)


def view(status, **known):
    return DriveView(drive=PUMP, line="hall", reachability="answers", status=status, **known)


def told(*views):
    return [(event.kind, event.text) for before, after in pairwise(views) for event in changes(before, after, 1.0)]


def test_a_warning_is_told_when_it_comes():
    assert told(view(READY), view(WARNED), view(WARNED), view(READY), view(WARNED)) == [("warning", "warning")] * 2
    assert told(DriveView(drive=PUMP, line="hall"), view(WARNED)) == [("warning", "warning")]


def test_a_state_is_told_when_it_changes():
    backwards = replace(RUNNING, reverse=True)
    assert told(view(READY), view(RUNNING), view(RUNNING), view(backwards)) == [
        ("change", "running"),
        ("change", "running backwards"),
    ]


def test_nothing_is_told_of_a_status_that_nobody_has_seen_before():
    assert told(DriveView(drive=PUMP, line="hall"), view(RUNNING), view(None), view(READY)) == []


def test_a_fault_is_told_when_it_comes_changes_and_goes():
    assert told(view(READY), view(READY, fault="5"), view(READY, fault="5"), view(READY, fault="14"), view(READY)) == [
        ("fault", "fault: 5"),
        ("fault", "fault: 14"),
        ("change", "the fault is gone"),
    ]
