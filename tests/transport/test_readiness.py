"""Waiting for a descriptor, on systems with and without poll and with many open descriptors."""

from __future__ import annotations

import os
import select
import threading

import pytest

from drivecomm.transport import Readable, readiness, send_all


@pytest.fixture(params=["poll", "many descriptors", "no poll"])
def pair(request, monkeypatch):
    theirs, ours = os.pipe()
    if request.param == "many descriptors":

        def full(*_):
            raise ValueError("filedescriptor out of range in select()")

        monkeypatch.setattr(readiness, "_SELECTABLE", 0)
        monkeypatch.setattr(select, "select", full)
    elif request.param == "no poll":
        monkeypatch.delattr(select, "poll", raising=False)
    yield Readable(theirs), ours, theirs
    os.close(ours)
    os.close(theirs)


def test_wait_ends_at_its_time(pair):
    readable, _, _ = pair
    for wait_s in (0.0003, 0.0015, 0.03):
        until = readiness._monotonic() + wait_s
        assert not readable.wait(until)
        assert until <= readiness._monotonic() < until + 0.5
    assert not readable.now()


def test_wait_ends_with_a_byte(pair):
    readable, ours, _ = pair
    timer = threading.Timer(0.02, os.write, [ours, b"x"])
    timer.start()
    began = readiness._monotonic()
    assert readable.wait(began + 10)
    assert readiness._monotonic() - began < 5
    assert readable.now()
    assert readable.wait(began - 1)
    timer.join()


def test_wait_beyond_the_longest_one_is_repeated(pair, monkeypatch):
    readable, _, _ = pair
    monkeypatch.setattr(readiness, "_LONGEST_S", 0.005)
    until = readiness._monotonic() + 0.03
    assert not readable.wait(until)
    assert readiness._monotonic() >= until


def test_send_all_waits_for_room_in_a_full_pipe(pair):
    _, ours, theirs = pair
    os.set_blocking(ours, False)
    data = bytes(range(256)) * 4096
    got = []

    def take():
        while len(b"".join(got)) < len(data):
            got.append(os.read(theirs, 65536))

    thread = threading.Thread(target=take)
    thread.start()
    assert send_all(lambda rest: os.write(ours, rest), ours, data, 5.0)
    thread.join()
    assert b"".join(got) == data
    began = readiness._monotonic()
    assert not send_all(lambda rest: os.write(ours, rest), ours, data, 0.05)
    assert 0.05 <= readiness._monotonic() - began < 2
