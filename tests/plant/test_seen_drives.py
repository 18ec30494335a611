"""Reachability and status of a drive after each result of its poll plan, for `drivecomm watch` and the server."""

import pytest

from drivecomm.errors import LineBusyError, LinkDownError, NoReplyError, OvertakenError, RefusedError
from drivecomm.line import STATUS, PollItem, PollResult
from drivecomm.plant.watching import DriveView, TrackedDrive, has_answered
from drivecomm.protocol import DriveConfig, DriveState, DriveStatus

SILENT = "did not answer"
READY = DriveStatus(state=DriveState.READY, word=0x31, running=False, fault=False)
RUNNING = DriveStatus(state=DriveState.RUNNING, word=0x37, running=True, fault=False)


def seen(**known):
    view = DriveView(drive=DriveConfig(protocol="vabus", address=1), line="hall", **known)
    return TrackedDrive(None, None, view, status=RUNNING)


def result(parameter=STATUS, error=None):
    item = PollItem(drive=None, parameter=parameter, name="pump")
    cause = "" if error is None else str(error)
    return PollResult(
        item, "pump", parameter, None, cause, error, time_s=1.0, due_s=0.0, late_s=0.0, took_s=0.0, missed=0
    )


def after(known, **of_result):
    told = result(**of_result)
    view = known.view_after(told, told.cause)
    return view.reachability, view.status, view.error


def test_drive_whose_status_is_read_counts_as_answering():
    assert after(seen(), parameter=STATUS) == ("answers", RUNNING, "")
    assert after(seen(reachability="silent", error=SILENT)) == ("answers", RUNNING, "")


def test_drive_whose_value_is_read_counts_as_answering_without_a_new_status():
    assert after(seen(reachability="silent", error=SILENT), parameter="481") == ("answers", None, "")
    assert after(seen(reachability="answers", status=READY, error="no"), parameter="481") == ("answers", READY, "no")


@pytest.mark.parametrize("parameter", [STATUS, "481"])
@pytest.mark.parametrize("error", [NoReplyError(SILENT), LinkDownError(SILENT)])
def test_drive_that_does_not_answer_is_silent(parameter, error):
    known = seen(reachability="answers", status=READY)
    assert after(known, parameter=parameter, error=error) == ("silent", None, SILENT)
    assert not has_answered(error)


@pytest.mark.parametrize("parameter", [STATUS, "481"])
@pytest.mark.parametrize("error", [OvertakenError("a stop went first"), LineBusyError("busy")])
def test_drive_without_a_request_keeps_its_reachability(parameter, error):
    """Otherwise a silent drive would be shown as answering while other requests hold the line."""
    for known in (seen(reachability="silent", error=SILENT), seen(reachability="answers", status=READY)):
        assert known.view_after(result(parameter, error), str(error)) is known.view
    assert not has_answered(error)


def test_drive_that_refuses_counts_as_answering():
    refusal = RefusedError("481", 3, "busy")
    assert after(seen(reachability="silent", error=SILENT), error=refusal)[0] == "answers"
    assert after(seen(reachability="answers", status=READY), parameter="481", error=refusal)[0] == "answers"
    assert has_answered(refusal)
