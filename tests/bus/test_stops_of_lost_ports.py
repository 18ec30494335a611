"""A stop does not wait for the pause after which a port that was lost is opened again."""

import asyncio
from contextlib import suppress

import pytest
from benches import ADDRESS, Mortal

from drivecomm.bus import open_bus, open_bus_async
from drivecomm.errors import LinkDownError
from drivecomm.virtual import VirtualLine


class Lost:
    """A line that is lost and has been tried in vain, and how often it was opened."""

    def __init__(self):
        self.line = VirtualLine([Mortal("vabus")])
        self.tries = 0

    def port(self):
        self.tries += 1
        return self.line.port()


def test_a_task_stops_a_drive_in_the_pause():
    async def main():
        lost = Lost()
        async with open_bus_async(lost.port) as bus:
            drive = bus.drive("vabus", ADDRESS)
            lost.line.broken = True
            for _ in range(3):
                with pytest.raises(LinkDownError):
                    await drive.read("481")
            lost.line.broken = False
            with pytest.raises(LinkDownError, match="opened again in"):
                await drive.read("481")
            await drive.stop()

    asyncio.run(main())


def test_a_thread_stops_a_drive_in_the_pause():
    lost = Lost()
    with open_bus(lost.port) as bus:
        drive = bus.drive("vabus", ADDRESS)
        lost.line.broken = True
        for _ in range(3):
            with pytest.raises(LinkDownError):
                drive.read("481")
        lost.line.broken = False
        with pytest.raises(LinkDownError, match="opened again in"):
            drive.read("481")
        drive.stop()


def test_many_stops_at_once_try_the_port_once():
    """Opening one may take seconds, and each would wait for all those before it."""

    async def main():
        lost = Lost()
        async with open_bus_async(lost.port) as bus:
            drives = [bus.drive("vabus", address) for address in range(1, 9)]
            lost.line.broken = True
            with suppress(LinkDownError):
                await drives[0].read("481")
            before = lost.tries
            ended = await asyncio.gather(*(drive.stop() for drive in drives), return_exceptions=True)
            assert {type(each) for each in ended} == {LinkDownError}
            assert lost.tries == before + 1

    asyncio.run(main())
