"""The wait command, references in rpm, and write --read-back."""

import pytest

from drivecomm.virtual import virtual_drive


def test_wait_ends_when_the_motor_reaches_the_state(shell):
    shell.line(virtual_drive("danfoss-fc", 3, model="fc300"))
    drive = ("danfoss-fc:3", "--model", "fc300")
    assert shell("start", *drive, "--percent", "40", "--link-loss", "hold") == 0
    assert shell("wait", "danfoss-fc:3", "at-reference", "--seconds", "20") == 0
    assert "running" in shell.out
    assert shell("wait", "danfoss-fc:3", "ready", "--seconds", "0.5") == 5
    assert "it is running" in shell.err


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("wait", "vabus:1", "somewhere"), "write one of at_reference"),
        (("reference", "vabus:1", "1450"), "1450rpm"),
    ],
)
def test_unknown_state_or_missing_unit_is_refused(shell, words, what):
    shell.line()
    assert shell(*words) == 2
    assert what in shell.err


def test_wait_exits_with_5_after_its_deadline(shell):
    shell.line()
    assert shell("wait", "vabus:1", "running", "--seconds", "0.5") == 5
    assert "did not reach 'running' within 0.5 s" in shell.err


def test_reference_in_rpm_is_converted(shell):
    drive = virtual_drive("vabus", 1, model="agile")
    shell.line(drive)
    assert shell("reference", "vabus:1", "1200rpm", "--model", "agile") == 0
    assert "reference 1200 rpm" in shell.out
    assert drive.peek("480", 0) == f"{4000:08X}"


def test_read_back_prints_the_written_value(shell):
    shell.line()
    assert shell("write", "vabus:1", "481", "12.5", "--read-back", "--model", "agile") == 0
    assert "12.50 Hz" in shell.out
