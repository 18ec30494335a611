"""Control Techniques ANSI tested against the public Rust crate x328-proto.

Its master commands our virtual drive, and our master its drive. The crate knows whole numbers of six characters only:
it accepts no decimal point.
"""

import os
import shutil
import subprocess
import tty
from contextlib import contextmanager

import pytest
from linuxcnc import served

import drivecomm
from drivecomm.errors import RefusedError
from drivecomm.virtual import virtual_drive

PROGRAM = os.environ.get("DRIVECOMM_X328") or shutil.which("x328_station") or ""

pytestmark = [
    pytest.mark.foreign,
    pytest.mark.skipif(
        not os.access(PROGRAM, os.X_OK),
        reason="DRIVECOMM_X328 names no x328_station, and there is none on PATH; x328_station.rs says how to build it",
    ),
]
PATIENCE_S = 20.0


def commanded(line, *orders):
    """Return the result that the crate's master reports for each order."""
    port = os.open(line, os.O_RDWR | os.O_NOCTTY)
    try:
        done = subprocess.run(
            [PROGRAM, "master", *orders], stdin=port, stdout=port, stderr=subprocess.PIPE, text=True, check=True,
            timeout=PATIENCE_S,
        )  # fmt: skip
    finally:
        os.close(port)
    return done.stderr.splitlines()


@pytest.fixture
def served_drive(tmp_path):
    drive = virtual_drive("ct-ansi", 11)
    with served(drive, tmp_path) as (line, _):
        yield drive, line


def test_master_of_the_crate_reads_writes_and_reports_refusals(served_drive):
    """Check reads, writes and refusals.

    After the start the status word shows healthy, active and at speed, since the reference is 0.
    """
    drive, line = served_drive
    assert commanded(line, "read:11:1040", "write:11:642:387", "read:11:1040", "read:11:2001", "write:11:1040:1") == [
        "1",
        "taken",
        "35",
        "Invalid parameter, EOT received.",
        "Command failed, NAK received.",
    ]
    assert drive.motor.running
    assert commanded(line, "write:11:642:385", "read:11:121") == ["taken", "Invalid response from node."]
    assert not drive.motor.running


def test_short_requests_of_the_crates_master_are_answered(served_drive):
    """The master repeats a read with NAK, reads the next parameter with ACK and the previous one with BS."""
    _, line = served_drive
    assert commanded(line, *[f"again:11:{place}" for place in (1124, 1124, 1125, 1125, 1124, 1123)]) == [
        *["0", "0", "2", "2", "0", "11"],
    ]


@contextmanager
def foreign_drive(*held):
    """Run a drive of the crate at address 11 that holds these values; yield the port and a list of writes.

    The list is filled when the drive ends.
    """
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    told = []
    with subprocess.Popen(
        [PROGRAM, "drive", "11", *held], stdin=ours, stdout=ours, stderr=subprocess.PIPE, text=True
    ) as program:
        os.close(ours)
        try:
            yield os.ttyname(theirs), told
        finally:
            # The program ends when the other end of its terminal is closed.
            os.close(theirs)
            told += program.communicate(timeout=PATIENCE_S)[1].splitlines()


def test_drive_of_the_crate_can_be_read_stopped_and_refuses_writes():
    with (
        foreign_drive("1040=8195", "642=0", "114=0", "115=0", "121=0", "2005=-7") as (port, told),
        drivecomm.open_bus(port) as bus,
    ):
        drive = bus.drive("ct-ansi", 11, model="unidrive-sp")
        status = drive.status()
        assert (status.running, status.reverse, status.fault) == (True, True, False)
        assert drive.read("20.05").value == -7
        drive.stop()
        assert drive.read("06.42").raw == 385
        with pytest.raises(RefusedError, match="no such parameter"):
            drive.read("20.06")
        with pytest.raises(RefusedError, match="unknown or read only"):
            drive.write("20.06", 1)
        with pytest.raises(RefusedError, match="came damaged"):
            drive.set_reference(hz=20)
        assert [(each.name, each.sound) for each in bus.scan(["ct-ansi"], [11])] == [("ct-ansi:11", True)]
    assert told == ["642=385"]
