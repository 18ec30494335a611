"""The time limit of a test also ends the processes that it started, before the test itself is interrupted.

pytest-timeout interrupts only the test; without this module the test would keep waiting for a child process.
"""

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest

CLEANING_UP_S = 20.0
"""Seconds that an interrupted test may take to clean up before it is interrupted again."""

_PARENT, _STARTED = 1, 19
"""Positions of the fields in /proc/PID/stat, counted after the name of the program."""


@pytest.hookimpl(wrapper=True)
def pytest_timeout_set_timer(settings):
    began = _ticks()
    try:
        return (yield)
    finally:
        if settings.method == "signal":
            _end_children_first(began)


def _end_children_first(began):
    interrupt = signal.getsignal(signal.SIGALRM)

    def time_is_up(number, frame):
        end_children(began)
        signal.setitimer(signal.ITIMER_REAL, CLEANING_UP_S)
        interrupt(number, frame)

    signal.signal(signal.SIGALRM, time_is_up)


def end_children(began):
    """Kill the processes that this process or its children have started since `began`."""
    processes = dict(_processes())
    ours, more = set(), {os.getpid()}
    while more:
        more = {number for number, (parent, _) in processes.items() if parent in more} - ours
        ours |= more
    for number in ours:
        if processes[number][1] >= began:
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)


def _processes():
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            told = stat.read_text().rpartition(")")[2].split()
            yield int(stat.parent.name), (int(told[_PARENT]), int(told[_STARTED]))


def _ticks():
    # Rounding down to whole ticks includes processes started in the same tick.
    return int(time.clock_gettime(time.CLOCK_BOOTTIME) * os.sysconf("SC_CLK_TCK"))
