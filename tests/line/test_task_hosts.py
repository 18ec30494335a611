"""Waiting for a port in tasks: by its descriptor, in a thread, or in virtual time; and its cancellation."""

import asyncio
import threading
import time
from functools import partial

import pytest
from benches import ADDRESS, Mortal

import drivecomm
from drivecomm.bus import open_bus_async
from drivecomm.line import Job, OwnThreadHost, VirtualTimeHost, task_host_for
from drivecomm.link import PortProxy
from drivecomm.protocol import Pause
from drivecomm.virtual import VirtualLine, virtual_drive


class Blocking(PortProxy):
    """A real-time port that only blocks: a virtual line whose time passes in step with real time."""

    paced, real_time, descriptor = True, True, None

    def __init__(self, line):
        self._port, self._line = line.port(), line
        self.calls = []

    def configure(self, settings):
        self.calls.append(threading.current_thread().name)
        return super().configure(settings)

    def read(self, until, at_least):
        came = b""
        while True:
            came += super().read(self._line.time, 1)
            if len(came) >= at_least or self._line.time >= until:
                return came
            self.wait(min(until, self._line.time + 0.002))

    def take(self):
        return super().read(self._line.time, 1)

    def wait(self, until):
        while (left := until - self._line.time) > 0:
            step = min(left, 0.002)
            time.sleep(step)
            self._line.advance(step)

    def close(self):
        pass


def test_task_host_suits_the_kind_of_port():
    async def main():
        line = VirtualLine([])
        assert isinstance(task_host_for(line.port()), VirtualTimeHost)
        runner = task_host_for(Blocking(line))
        assert isinstance(runner, OwnThreadHost)
        runner.close()

    asyncio.run(main())


def test_blocking_port_does_not_block_the_event_loop():
    async def main():
        line = VirtualLine([Mortal("vabus")])
        port = Blocking(line)
        async with open_bus_async(lambda: port) as bus:
            drive = bus.drive("vabus", ADDRESS)
            ticks = []

            async def tick():
                while True:
                    ticks.append(time.monotonic())
                    await asyncio.sleep(0.001)

            ticking = asyncio.create_task(tick())
            for parameter, raw in (("481", "000003E8"), ("482", "000009C4")):
                assert (await drive.read(parameter)).raw == raw
            ticking.cancel()
            assert len(ticks) > 10
            assert all(name.startswith("drivecomm") for name in port.calls)

    asyncio.run(main())


@pytest.mark.parametrize("times", [1, 3])
@pytest.mark.parametrize("after_s", [0.0, 0.003, 0.012, 0.025])
def test_thread_of_a_port_stops_when_its_task_is_cancelled(after_s, times):
    """The request is on the wire, unanswered, or being answered, by the clock of the line."""

    async def main():
        line = VirtualLine([Mortal("vabus")])
        async with open_bus_async(lambda: Blocking(line)) as bus:
            drive = bus.drive("vabus", ADDRESS)
            silent = bus.drive("vabus", 9, reply_timeout_s=20.0)
            loop = asyncio.get_running_loop()
            for victim in (drive, silent):
                there, cancelled = asyncio.Event(), threading.Event()

                def hold(there=there, cancelled=cancelled):
                    loop.call_soon_threadsafe(there.set)
                    assert cancelled.wait(10)

                line.call_at(line.time + after_s, hold)
                reading = asyncio.create_task(victim.read("481"))
                await asyncio.wait_for(there.wait(), 10)
                began = time.monotonic()
                for _ in range(times):
                    reading.cancel()
                    await asyncio.sleep(0)
                cancelled.set()
                with pytest.raises(asyncio.CancelledError):
                    await reading
                assert time.monotonic() - began < 1.0
                assert (await drive.read("482")).raw == "000009C4"
            assert bus.counters[drive.name]["timeouts"] == 0

    asyncio.run(main())


def test_thread_in_a_pause_stops_when_its_task_is_cancelled():
    def pausing():
        yield Pause(seconds=5.0)

    async def main():
        line = VirtualLine([Mortal("vabus")])
        async with open_bus_async(lambda: Blocking(line)) as bus:
            drive, there = bus.drive("vabus", ADDRESS), asyncio.Event()
            line.call_at(0.01, partial(asyncio.get_running_loop().call_soon_threadsafe, there.set))
            waiting = asyncio.create_task(bus.run(Job(drive.peer, pausing())))
            await asyncio.wait_for(there.wait(), 10)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            assert line.time < 4.0

    asyncio.run(main())


@pytest.mark.soak
def test_port_without_a_descriptor_has_its_own_thread(serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], "rfc2217") as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                assert isinstance(bus.line.host, OwnThreadHost)
                assert (await bus.drive("vabus", 1).read("481", type="long")).raw == "000003E8"

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_cancelling_at_any_time_leaves_the_line_usable(kind, serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], kind) as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                drive = bus.drive("vabus", 1)
                for number in range(40):
                    reading = asyncio.create_task(drive.read("481", type="long"))
                    await asyncio.sleep(0.0008 * number)
                    reading.cancel()
                    await asyncio.gather(reading, return_exceptions=True)
                    assert (await drive.read("482", type="long")).raw == "000009C4"
                assert bus.counters[drive.name]["timeouts"] == 0

    asyncio.run(main())
