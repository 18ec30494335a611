"""A lent port waits as long as the real port does, and for as many bytes, until it is taken back."""

import pytest

from drivecomm.line.lending import LentPort


class Trickle:
    """A port that receives one byte each hundredth of a second."""

    paced, real_time, descriptor = True, True, None

    def __init__(self):
        self.time, self.sent = 0.0, []

    def now(self):
        return self.time

    def write(self, data):
        self.sent.append(data)

    def read(self, until, at_least):
        number = max(0, min(at_least, round((until - self.time) / 0.01)))
        self.time = min(until, self.time + number * 0.01)
        return b"x" * number

    def wait(self, until):
        self.time = until


@pytest.fixture
def port():
    return Trickle()


def test_lent_port_waits_for_as_many_bytes_as_the_real_port(port):
    lent = LentPort(port, lambda: None)
    assert lent.read(10.0, 30) == b"x" * 30
    assert lent.read(lent.now() + 0.1, 30) == b"x" * 10


def test_lent_port_ends_its_waits_when_it_is_taken_back(port):
    def taken_back():
        if port.time > 0.5:
            raise ZeroDivisionError

    lent = LentPort(port, taken_back)
    for use in (lambda: lent.wait(10.0), lambda: lent.read(10.0, 3000), lambda: lent.write(b"more")):
        with pytest.raises(ZeroDivisionError):
            use()
        assert 0.5 < port.time < 0.53
    assert port.sent == []
