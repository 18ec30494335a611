"""Starting a motor at a reference: the order of the telegrams, and the check before each of them."""

from decimal import Decimal
from types import SimpleNamespace

import pytest

from drivecomm.bus import carry_out, starting
from drivecomm.errors import CommandCancelledError, OvertakenError

HALF = {"reverse": False, "percent": Decimal(50), "hz": None}
STANDING, RUNNING = ["status", "reference", "start"], ["status", "start", "reference"]


class Drive:
    """A drive that records its calls. overtaken: reading its status raises OvertakenError."""

    def __init__(self, *, running, overtaken=False):
        self.running, self.overtaken, self.done = running, overtaken, []

    def status(self):
        if self.overtaken:
            raise OvertakenError("the status was not read: a stop came first")
        self.done.append("status")
        return SimpleNamespace(running=self.running)

    def start(self, *, reverse):
        self.done.append("start reversed" if reverse else "start")

    def set_reference(self, *, percent, hz):
        assert (percent, hz) == (Decimal(50), None)
        self.done.append("reference")


@pytest.mark.parametrize(("running", "order"), [(False, STANDING), (True, RUNNING)])
def test_running_motor_is_started_before_it_gets_its_reference(running, order):
    drive = Drive(running=running)
    carry_out(drive, starting(**HALF))
    assert drive.done == order


def test_start_without_a_reference_reads_no_status():
    drive = Drive(running=True)
    carry_out(drive, starting(reverse=True, percent=None, hz=None))
    assert drive.done == ["start reversed"]


@pytest.mark.parametrize(("running", "order"), [(False, STANDING), (True, RUNNING)])
@pytest.mark.parametrize("commands", [0, 1])
def test_failing_check_prevents_the_next_command_of_a_start(running, order, commands):
    drive, left = Drive(running=running), commands

    def check():
        nonlocal left
        if not left:
            raise CommandCancelledError("stopped")
        left -= 1

    with pytest.raises(CommandCancelledError):
        carry_out(drive, starting(**HALF, check=check))
    assert drive.done == order[: 1 + commands]


def test_check_runs_right_before_each_command_of_a_start():
    drive = Drive(running=False)
    carry_out(drive, starting(**HALF, check=lambda: drive.done.append("check")))
    assert drive.done == ["status", "check", "reference", "check", "start"]


def test_overtaking_stop_raises_the_error_of_the_check():
    def check():
        raise CommandCancelledError("stopped")

    drive = Drive(running=False, overtaken=True)
    with pytest.raises(CommandCancelledError):
        carry_out(drive, starting(**HALF, check=check))
    with pytest.raises(OvertakenError):
        carry_out(drive, starting(**HALF))
    assert drive.done == []
