"""A request that the drive reports as damaged is retried; any other refusal is final."""

from dataclasses import replace

import pytest

import drivecomm
from drivecomm.errors import DamagedReplyError, RefusedError
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

MISHEARD = 4
NAME = "0x2103"


class RefusedRequests:
    """A disturbance that replaces the next replies by refusals with these codes."""

    def __init__(self, *codes):
        self.codes = list(codes)
        self.asked = 0

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        self.asked += 1
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        if not self.codes:
            return [(0.0, data)]
        fields = {"address": 1, "function": data[1] & 0x7F, "exception": self.codes.pop(0)}
        return [(0.0, drivecomm.encode("modbus", fields, direction="reply"))]


@pytest.fixture(params=[None, lambda _: None], ids=["short way", "long way"])
def opened(request, monkeypatch):
    """Yield a drive with one code for damaged requests, and a function that makes it refuse."""
    plugin = replace(installed["modbus"], line_errors={"exception": frozenset({MISHEARD})})
    monkeypatch.setitem(installed._loaded, "modbus", plugin)
    line = VirtualLine([virtual_drive("modbus", 1, model="delta")])

    with drivecomm.open_bus(line.port, trace=request.param) as bus:
        drive = bus.drive("modbus", 1, model="delta")
        drive.read(NAME)

        def refusing(*codes):
            refuses = RefusedRequests(*codes)
            line.disturbances.append(refuses)
            return refuses

        yield drive, refusing


def test_damaged_request_is_sent_again(opened):
    drive, refusing = opened
    refuses = refusing(MISHEARD, MISHEARD)
    assert drive.read(NAME).quality == "good"
    assert refuses.asked == 3


def test_request_damaged_at_each_attempt_raises_damaged_reply_error(opened):
    drive, refusing = opened
    refuses = refusing(*4 * [MISHEARD])
    with pytest.raises(DamagedReplyError, match=r"reports that the request arrived damaged \(asked 3 times\)"):
        drive.read(NAME)
    assert refuses.asked == 3


def test_other_refusal_is_final(opened):
    drive, refusing = opened
    refuses = refusing(2)
    with pytest.raises(RefusedError):
        drive.read(NAME)
    assert refuses.asked == 1


def test_damaged_start_is_not_sent_again(opened):
    """A command that must not be carried out twice is sent once, even if the drive reports it as damaged."""
    drive, refusing = opened
    drive.set_reference(hz=20)
    refuses = refusing()
    refuses.codes = 20 * [MISHEARD]
    with pytest.raises(DamagedReplyError):
        drive.start()
