"""Doors in threads of their own: whatever ends one, it is opened again, and the server hears of it."""

import asyncio
import threading

import pytest

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


@pytest.mark.parametrize("fail", [RuntimeError("a mistake"), SystemExit(3), asyncio.CancelledError()])
def test_a_door_that_fails_is_opened_again(fail):
    told, door = [], Door(fail)
    watched = OpenDoor(door, None, told.append)
    assert door.opened_again.wait(5)
    watched.close()
    assert any("failed" in text for text in told)
    assert told[-1] == "door a door is opened again"
