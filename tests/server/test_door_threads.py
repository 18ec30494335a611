"""Doors in separate threads: a door that ends for any reason is reopened, and the failure is reported."""

import asyncio
import threading

import pytest

from drivecomm.link import Backoff
from drivecomm.server import supervision
from drivecomm.server.supervision import OpenDoor


class Door:
    name = "a door"

    def __init__(self, fail):
        self._fail, self.opened_again = fail, threading.Event()
        self._begun = 0

    async def run(self, _plant, opened):
        self._begun += 1
        opened()
        if self._begun > 1:
            self.opened_again.set()
            await asyncio.Event().wait()
        raise self._fail


@pytest.mark.soak
@pytest.mark.parametrize("fail", [RuntimeError("a mistake"), SystemExit(3), asyncio.CancelledError()])
def test_failed_door_is_reopened(fail):
    told, door = [], Door(fail)
    watched = OpenDoor(door, None, told.append)
    assert door.opened_again.wait(5)
    watched.close()
    assert any("failed" in text for text in told)
    assert told[-1] == "door a door is opened again"


def test_door_that_worked_is_reopened_after_the_shortest_pause(monkeypatch):
    pauses, times = [], 5

    class Noted(Backoff):
        def failed(self, now, least_s=0.0):
            super().failed(now, least_s)
            pauses.append(round(self.over_at - now, 6))

    class Failing(Door):
        async def run(self, _plant, opened):
            opened()
            if len(pauses) == times:
                self.opened_again.set()
                await asyncio.Event().wait()
            raise RuntimeError("a mistake")

    monkeypatch.setattr(supervision, "Backoff", Noted)
    monkeypatch.setattr(supervision, "_FIRST_S", 0.01)
    door = Failing(None)
    watched = OpenDoor(door, None, lambda _: None)
    assert door.opened_again.wait(20)
    watched.close()
    assert pauses == [0.01] * times


def test_door_that_never_opens_is_retried_after_growing_pauses(monkeypatch):
    pauses, enough = [], threading.Event()

    class Noted(Backoff):
        def failed(self, now, least_s=0.0):
            super().failed(now, least_s)
            pauses.append(round(self.over_at - now, 6))
            if len(pauses) == 4:
                enough.set()

    class Closed(Door):
        async def run(self, _plant, _opened):
            raise RuntimeError("a mistake")

    monkeypatch.setattr(supervision, "Backoff", Noted)
    monkeypatch.setattr(supervision, "_FIRST_S", 0.01)
    watched = OpenDoor(Closed(None), None, lambda _: None)
    assert enough.wait(20)
    watched.close()
    assert pauses[:4] == [0.01, 0.02, 0.04, 0.08]


def test_door_opens_once_an_event_loop_can_be_created(monkeypatch):
    monkeypatch.setattr(supervision, "_LOOP_AGAIN_S", 0.05)
    told, door, left = [], Door(RuntimeError("a mistake")), [OSError("too many open files")] * 2

    def loop_factory():
        if left:
            raise left.pop()
        return asyncio.SelectorEventLoop()

    door.loop_factory = loop_factory
    watched = OpenDoor(door, None, told.append)
    assert watched.opened.wait(5)
    assert told[:2] == ["door a door failed: too many open files"] * 2
    watched.close()


def test_door_without_an_event_loop_ends_with_the_server():
    def loop_factory():
        raise OSError("too many open files")

    door = Door(RuntimeError("a mistake"))
    door.loop_factory = loop_factory
    told = []
    watched = OpenDoor(door, None, told.append)
    watched.close()
    assert not any("left behind" in text for text in told)
