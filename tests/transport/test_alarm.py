"""The kernel timer: never early, more precise than sleep, usable as a descriptor, and closed with its port."""

from __future__ import annotations

import ctypes
import os
import select
import statistics
import subprocess
import sys
import threading
import time

import pytest

from drivecomm.transport import SerialPort, kernel_timer as alarm_module, open_timer

linux = pytest.mark.skipif(sys.platform != "linux", reason="timerfd is Linux's")


@pytest.fixture
def alarm():
    found = open_timer()
    yield found
    found.close()


def readable(alarm, wait_s=0.0):
    return bool(select.select([alarm.descriptor], [], [], wait_s)[0])


@linux
class TestAlarm:
    def test_timer_never_ends_early(self, alarm):
        for _ in range(100):
            until = time.monotonic() + 0.001
            alarm.wait(until)
            assert time.monotonic() >= until

    def test_timer_is_more_precise_than_sleep(self, alarm):
        """Sleep ends at least 50 us late; on a busy machine both are worse, so the quickest of many count."""

        def overshoots(wait):
            for _ in range(100):
                until = time.monotonic() + 0.001
                wait(until)
                yield time.monotonic() - until

        asleep = statistics.quantiles(overshoots(lambda until: time.sleep(until - time.monotonic())), n=10)[0]
        awake = statistics.quantiles(overshoots(alarm.wait), n=10)[0]
        assert awake < asleep

    def test_timer_set_to_the_past_does_not_wait(self, alarm):
        began = time.monotonic()
        alarm.wait(began - 10)
        alarm.wait(float("-inf"))
        assert time.monotonic() - began < 0.5

    @pytest.mark.parametrize("until", [0.0, -1.0, float("-inf")])
    def test_timer_set_to_zero_or_less_ends_immediately(self, alarm, until):
        alarm.set(until)
        assert readable(alarm, 1.0)

    def test_select_loop_can_watch_a_timer(self, alarm):
        began = time.monotonic()
        alarm.set(began + 0.02)
        assert not readable(alarm)
        assert readable(alarm, 1.0)
        assert time.monotonic() >= began + 0.02
        assert readable(alarm)
        alarm.set(began + 1000)
        assert not readable(alarm)

    def test_timer_can_be_cleared_before_and_after_its_end(self, alarm):
        alarm.set(time.monotonic() + 0.01)
        alarm.clear()
        assert not readable(alarm, 0.03)
        alarm.set(time.monotonic())
        assert readable(alarm, 1.0)
        alarm.clear()
        assert not readable(alarm)

    def test_infinite_timer_never_ends(self, alarm):
        alarm.set(float("inf"))
        assert not readable(alarm)

    def test_timer_is_not_inherited_by_another_program(self, alarm):
        code = f"import os; os.fstat({alarm.descriptor})"
        ran = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, close_fds=False)
        assert b"Bad file descriptor" in ran.stderr

    def test_timer_may_be_closed_twice(self):
        alarm = open_timer()
        alarm.close()
        alarm.close()


@pytest.mark.parametrize("lacking", ["system", "function", "descriptors"])
def test_port_waits_without_a_timer_on_systems_that_lack_it(lacking, monkeypatch):
    if lacking == "system":
        monkeypatch.setattr(alarm_module.sys, "platform", "darwin")
    elif lacking == "function":
        monkeypatch.setattr(ctypes, "PyDLL", lambda _: object())
    else:

        class Library:
            timerfd_create = staticmethod(lambda *_: -1)
            timerfd_settime = None

        monkeypatch.setattr(ctypes, "PyDLL", lambda _: Library)
    assert open_timer() is None
    port = SerialPort("loop://")
    until = port.now() + 0.01
    port.wait(until)
    assert until <= port.now() < until + 0.5
    port.close()


def test_closed_port_closes_its_timer():
    """The watch over all tests in this folder detects descriptors that stay open."""
    port = SerialPort("loop://")
    port.wait(port.now() + 0.002)
    port.close()
    until = port.now() + 0.002
    port.wait(until)
    assert port.now() >= until


def test_threads_can_wait_on_one_port_concurrently():
    port = SerialPort("loop://")
    late = []

    def wait():
        for _ in range(20):
            until = port.now() + 0.002
            port.wait(until)
            late.append(port.now() - until)

    threads = [threading.Thread(target=wait) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert len(late) == 160
    assert min(late) >= 0
    port.close()


def test_ctrl_c_ends_a_wait():
    port = SerialPort("loop://")
    code = os.getpid()
    timer = threading.Timer(0.05, lambda: os.kill(code, 2))
    timer.start()
    began = port.now()
    with pytest.raises(KeyboardInterrupt):
        port.wait(began + 10)
    timer.join()
    until = port.now() + 0.005
    port.wait(until)
    assert until <= port.now() < began + 5
    port.close()
