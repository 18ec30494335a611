"""An event that a signal sets: at whatever instruction the handler comes, nobody waits for ever."""

import sys
import time
from threading import Event, Thread
from types import SimpleNamespace

import pytest
from extents import every

from drivecomm.bus import WatchdogKeeper
from drivecomm.cli.signals import SignalledEvent

INSTRUCTIONS = 150
"""More than a short wait has; what comes later is set by the end of the test."""


def interrupted_at(place, wait, handler):
    """Call the handler within a wait, before its instruction with this number; returns whether the wait ended.

    A signal handler comes in the same way: in between, and in the same thread.
    """
    passed = 0

    def trace(frame, kind, _):
        nonlocal passed
        frame.f_trace_opcodes = True
        if kind == "opcode":
            passed += 1
            if passed == place:
                handler()
        return trace

    def run():
        sys.settrace(trace)
        try:
            wait()
        finally:
            sys.settrace(None)

    thread = Thread(target=run, daemon=True)
    thread.start()
    thread.join(0.3 if passed < place else 3)
    if passed < place:
        handler()
    thread.join(3)
    return not thread.is_alive()


@pytest.mark.parametrize("place", every(5, range(1, INSTRUCTIONS, 7)))
def test_a_wait_ends_wherever_it_is_interrupted(place):
    event = SignalledEvent()
    assert interrupted_at(place, event.wait, event.set)
    assert event.is_set()


@pytest.mark.parametrize("place", every(5, range(1, INSTRUCTIONS, 3)))
def test_a_motor_is_kept_no_longer_wherever_that_is_interrupted(place):
    event = Event()
    keeper = SimpleNamespace(
        _drive=SimpleNamespace(bus=SimpleNamespace(real_time=True)), _failed=Event(), _raise_first=lambda: None
    )
    assert interrupted_at(place, lambda: WatchdogKeeper.until(keeper, event), event.set)


def test_all_that_wait_go_on():
    event, ended = SignalledEvent(), []
    threads = [Thread(target=lambda: ended.append(event.wait(5)), daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    time.sleep(0.05)
    assert ended == []
    event.set()
    event.set()
    for thread in threads:
        thread.join(3)
    assert ended == [True, True, True]
    assert event.wait()


def test_a_wait_has_its_time():
    event = SignalledEvent()
    assert not event.wait(0.01)
    assert not event.wait(0)
    assert not event.is_set()
    event.set()
    assert event.wait(0)
