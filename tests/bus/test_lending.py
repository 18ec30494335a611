"""A bus lends its port: to one who has it alone, until they are done or a stop comes."""

import asyncio
import threading
import time

import pytest

from drivecomm.bus import open_bus, open_bus_async
from drivecomm.errors import LinkDownError


@pytest.fixture
def line(virtual_line):
    return virtual_line(["vabus:1,model=agile"], listen="tcp")


def sit(_port, lent):
    lent.wait(lent.now() + 10)


def test_who_borrows_has_the_port_alone_and_the_bus_goes_on_after_it(line):
    with open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1)
        drive.status()

        def ask(port, lent):
            assert port is not lent
            with open_bus(lambda: lent) as other:
                return other.drive("vabus", 1).status().state

        assert bus.lend(ask) == drive.status().state


def test_a_stop_takes_it_back(line):
    with open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1)
        stopper = threading.Timer(0.2, drive.stop)
        stopper.start()
        began = time.monotonic()
        with pytest.raises(LinkDownError, match="a stop goes first"):
            bus.lend(sit)
        assert time.monotonic() - began < 2
        stopper.join()
        assert not drive.status().running


def test_a_stop_takes_it_back_from_a_task(line):
    async def main():
        async with open_bus_async(line.port) as bus:
            drive = bus.drive("vabus", 1)
            lending = asyncio.create_task(bus.lend(sit))
            await asyncio.sleep(0.2)
            began = time.monotonic()
            await drive.stop()
            assert time.monotonic() - began < 2
            with pytest.raises(LinkDownError, match="a stop goes first"):
                await lending

    asyncio.run(main())


def test_whoever_is_cancelled_gives_it_back(line):
    async def main():
        async with open_bus_async(line.port) as bus:
            lending = asyncio.create_task(bus.lend(sit))
            await asyncio.sleep(0.2)
            lending.cancel()
            with pytest.raises(asyncio.CancelledError):
                await lending
            assert (await bus.drive("vabus", 1).status()).word >= 0

    asyncio.run(main())
