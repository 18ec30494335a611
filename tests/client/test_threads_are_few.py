"""Event loops whose threads are all blocked: lines still open, and motors still stop."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

from benches import ADDRESS, Mortal

from drivecomm.bus import open_bus_async
from drivecomm.client import AsyncServedBus
from drivecomm.virtual import VirtualLine

SOON_S = 1.0


@contextmanager
def no_thread_left():
    """Occupy the only executor thread of the running loop within the block."""
    over = Event()
    threads = ThreadPoolExecutor(1)
    loop = asyncio.get_running_loop()
    loop.set_default_executor(threads)
    loop.run_in_executor(None, over.wait)
    try:
        yield
    finally:
        over.set()


def test_line_opens_without_a_free_thread():
    async def main():
        with no_thread_left():
            async with asyncio.timeout(SOON_S), open_bus_async(VirtualLine([Mortal("vabus")]).port) as bus:
                await bus.drive("vabus", ADDRESS).stop()

    asyncio.run(main())


def test_served_drive_is_stopped_without_a_free_thread(monkeypatch):
    monkeypatch.setattr(AsyncServedBus, "sent", lambda _bus, _of, verb, _arguments: f"{verb} was sent")

    async def main():
        with no_thread_left():
            bus = AsyncServedBus.__new__(AsyncServedBus)
            async with asyncio.timeout(SOON_S):
                assert await bus.carry_out(None, "stop", {}) == "stop was sent"

    asyncio.run(main())
