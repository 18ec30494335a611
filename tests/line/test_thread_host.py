"""A thread that waits for a reply polls for waiting stops, no more often than needed."""

import threading

import pytest

from drivecomm.line import run_steps
from drivecomm.link import Receive, Wait


class SilentPort:
    """A port that never receives anything, with a clock that only waiting moves."""

    real_time = True

    def __init__(self):
        self.time, self.waits = 0.0, []

    def now(self):
        return self.time

    def wait(self, until):
        self.waits.append(until - self.time)
        self.time = until

    def read(self, until, _):
        self.wait(until)
        return b""


@pytest.mark.parametrize("effect", [Receive(1.0, 5, True), Wait(1.0, True)])
@pytest.mark.parametrize(("threads", "longest_s"), [(1, 0.05), (2, 0.01)])
def test_wait_polls_for_stops_more_often_with_other_threads(monkeypatch, effect, threads, longest_s):
    monkeypatch.setattr(threading, "active_count", lambda: threads)
    port = SilentPort()

    def steps():
        yield effect

    run_steps(steps(), port, lambda: False)
    assert sum(port.waits) == pytest.approx(1.0)
    assert max(port.waits) == pytest.approx(longest_s)
    assert len(port.waits) == pytest.approx(1.0 / longest_s, abs=1)


@pytest.mark.parametrize("effect", [Receive(1.0, 5, True), Wait(1.0, True)])
@pytest.mark.parametrize("threads", [1, 2])
def test_waiting_stop_ends_the_wait_at_the_next_poll(monkeypatch, effect, threads):
    monkeypatch.setattr(threading, "active_count", lambda: threads)
    port = SilentPort()

    def steps():
        yield effect

    run_steps(steps(), port, lambda: port.time > 0.3)
    assert 0.3 < port.time <= 0.36


def test_wait_that_does_not_yield_to_stops_is_not_split():
    port = SilentPort()

    def steps():
        yield Receive(1.0, 5, False)

    run_steps(steps(), port, lambda: True)
    assert port.waits == [1.0]
