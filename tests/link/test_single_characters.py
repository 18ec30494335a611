"""A reply of one character is accepted if it stands alone: inside longer noise it occurs by chance."""

import pytest

import drivecomm
from drivecomm.errors import DamagedReplyError, DoubtfulReplyError
from drivecomm.virtual import VirtualLine, virtual_drive

ACK = b"\x06"


class Among:
    """A disturbance that puts noise before and after each confirmation."""

    def __init__(self, before, behind):
        self.before, self.behind = before, behind
        self.asked = 0

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        self.asked += 1
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(0.0, self.before + data + self.behind if data == ACK else data)]


@pytest.fixture(params=[None, lambda _: None], ids=["short way", "long way"])
def opened(request):
    line = VirtualLine([virtual_drive("ct-ansi", 12)])
    with drivecomm.open_bus(line.port, trace=request.param) as bus:
        drive = bus.drive("ct-ansi", 12)
        drive.read("01.14")

        def among(before, behind):
            noise = Among(before, behind)
            line.disturbances.append(noise)
            return noise

        yield drive, among


@pytest.mark.parametrize("before", [b"", b"\x00", b"\xff"])
def test_single_confirmation_is_accepted(opened, before):
    """A transmitter that switches on may produce one character."""
    drive, among = opened
    noise = among(before, b"")
    drive.write("01.14", 0)
    assert noise.asked == 1


@pytest.mark.parametrize(
    ("before", "behind", "error"),
    [
        (b"\x0e\x01", b"", DamagedReplyError),
        (b"", b"\x0b\x41", DoubtfulReplyError),
        (b"\x0e\x01\x02", b"\x0b\x41", DamagedReplyError),
    ],
)
def test_confirmation_in_noise_is_not_accepted(opened, before, behind, error):
    drive, among = opened
    noise = among(before, behind)
    with pytest.raises(error):
        drive.write("01.14", 0)
    assert noise.asked > 1
