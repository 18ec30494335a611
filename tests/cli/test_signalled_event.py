"""Events set by a signal handler: a wait always ends, whichever of its instructions the handler interrupts."""

import sys
import time
from threading import Event, Thread
from types import SimpleNamespace

import pytest
from extents import every

from drivecomm.bus import WatchdogKeeper
from drivecomm.cli.signals import SignalledEvent

INSTRUCTIONS = 150
"""More instructions than a short wait has; a handler that was not called by then is called at the end of the test."""


def interrupted_at(place, wait, handler):
    """Call the handler during a wait, before instruction number `place`; return whether the wait ended.

    A signal handler runs in the same way: between two instructions, in the same thread.
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
def test_wait_ends_at_whichever_instruction_the_event_is_set(place):
    event = SignalledEvent()
    assert interrupted_at(place, event.wait, event.set)
    assert event.is_set()


@pytest.mark.parametrize("place", every(5, range(1, INSTRUCTIONS, 3)))
def test_watchdog_keeper_ends_at_whichever_instruction_the_event_is_set(place):
    event = Event()
    keeper = SimpleNamespace(
        _drive=SimpleNamespace(bus=SimpleNamespace(real_time=True)), _failed=Event(), _raise_first=lambda: None
    )
    assert interrupted_at(place, lambda: WatchdogKeeper.until(keeper, event), event.set)


def test_set_event_wakes_all_waiting_threads():
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


def test_wait_returns_false_after_its_timeout():
    event = SignalledEvent()
    assert not event.wait(0.01)
    assert not event.wait(0)
    assert not event.is_set()
    event.set()
    assert event.wait(0)
