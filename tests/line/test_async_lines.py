"""Real bytes for both faces: every protocol over terminals and TCP with asyncio, and lines that die under traffic."""

from __future__ import annotations

import asyncio
import threading
import time
from contextlib import contextmanager

import pytest

import drivecomm
from drivecomm.errors import LinkDownError, LinkError, PortError
from drivecomm.line import OwnThreadHost, ReadinessHost
from drivecomm.virtual import Server, parse_listen, virtual_drive

KINDS = ("pty", "tcp")
AT_ONCE_S = 0.2
"""How soon a call must know that its line has gone."""

LONG = {"type": "long"}


@contextmanager
def served(drives, listen):
    """Serve drives until the block ends; stopping takes no longer than a tick."""
    stop = threading.Event()
    with Server(drives, parse_listen(listen)) as server:
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            yield server
        finally:
            stop.set()
            thread.join()


@pytest.fixture
def place(tmp_path):
    """Return where to listen, the same place again and again."""

    def choose(kind):
        if kind == "pty":
            return f"pty:{tmp_path / 'line'}"
        with served([], "tcp:127.0.0.1:0") as server:
            return f"tcp:127.0.0.1:{server.address.rpartition(':')[2]}"

    return choose


# asyncio over real ports


def test_a_short_reply_time_is_kept_behind_a_long_one(serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], "pty") as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                patient = bus.drive("vabus", 1, reply_timeout_s=20.0)
                hasty = bus.drive("vabus", 9, reply_timeout_s=0.1, attempts=1)
                await patient.probe()
                began = time.monotonic()
                with pytest.raises(drivecomm.NoReplyError):
                    await hasty.probe()
                assert time.monotonic() - began < 5.0

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_is_read_and_written(example, kind, serving):
    async def main():
        virtual = example.virtual()
        with serving([virtual], kind) as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                assert isinstance(bus.line.host, ReadinessHost)
                drive = example.on(bus)
                for _ in range(5):
                    reading = await drive.read(example.parameter)
                    assert reading.raw == virtual.peek(example.parameter, server.now())
                await drive.status()
                await drive.stop()
                counters = bus.counters[drive.name]
                assert counters["retries"] == 0
                assert counters["replies"] == counters["requests"]

    asyncio.run(main())


@pytest.mark.soak
def test_a_port_without_a_descriptor_has_a_thread(serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], "rfc2217") as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                assert isinstance(bus.line.host, OwnThreadHost)
                assert (await bus.drive("vabus", 1).read("481", **LONG)).raw == "000003E8"

    asyncio.run(main())


def test_loop_is_a_line_with_echo_and_nobody_on_it():
    async def main():
        async with drivecomm.open_bus_async("loop://", echo=True, reply_timeout_s=0.02, attempts=2) as bus:
            assert isinstance(bus.line.host, OwnThreadHost)
            drive = bus.drive("vabus", 1)
            with pytest.raises(drivecomm.NoReplyError):
                await drive.read("481", **LONG)
            assert bus.counters[drive.name]["echo bytes"] == 16
            silent = asyncio.create_task(bus.drive("vabus", 2, reply_timeout_s=20.0).probe())
            await asyncio.sleep(0.02)
            began = time.monotonic()
            silent.cancel()
            with pytest.raises(asyncio.CancelledError):
                await silent
            assert time.monotonic() - began < 1.0
            with pytest.raises(drivecomm.NoReplyError):
                await drive.probe()

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_drives_of_all_protocols_share_a_line(examples, kind, serving):
    async def main():
        virtual = [example.virtual() for example in examples]
        with serving(virtual, kind) as server:
            async with drivecomm.open_bus_async(server.address) as bus:

                async def read(example, drive):
                    for _ in range(3):
                        reading = await example.on(bus).read(example.parameter)
                        assert reading.raw == drive.peek(example.parameter, server.now())

                await asyncio.gather(*(read(*pair) for pair in zip(examples, virtual, strict=True)))

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_cancelling_at_any_time_leaves_the_line_usable(kind, serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], kind) as server:
            async with drivecomm.open_bus_async(server.address) as bus:
                drive = bus.drive("vabus", 1)
                for number in range(40):
                    reading = asyncio.create_task(drive.read("481", **LONG))
                    await asyncio.sleep(0.0008 * number)
                    reading.cancel()
                    await asyncio.gather(reading, return_exceptions=True)
                    assert (await drive.read("482", **LONG)).raw == "000009C4"
                assert bus.counters[drive.name]["timeouts"] == 0

    asyncio.run(main())


def test_waiting_is_precise(serving):
    async def main():
        with serving([virtual_drive("vabus", 1)], "pty") as server:
            async with drivecomm.open_bus_async(server.address, request_interval_s=0.05) as bus:
                drive = bus.drive("vabus", 1)
                await drive.probe()
                began = time.monotonic()
                await bus.sleep_until(bus.now() + 0.05)
                assert 0.05 <= time.monotonic() - began < 0.1

    asyncio.run(main())


# Lines that die under traffic


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_that_dies_while_a_reply_is_awaited(kind, place):
    """The call knows it at once, though the drive had five seconds to answer."""
    listen = place(kind)
    died = []
    with served([virtual_drive("vabus", 1)], listen) as server:
        bus = drivecomm.open_bus(server.address)
        bus.drive("vabus", 1).read("481", **LONG)
        caught = []

        def ask():
            try:
                bus.drive("vabus", 2, reply_timeout_s=5.0).probe()
            except Exception as error:  # noqa: BLE001 - the test asks for it
                caught.append((time.monotonic(), error))

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(0.1)
        died.append(time.monotonic())
    died.append(time.monotonic())
    asking.join(10)
    bus.close()
    ((when, error),) = caught
    assert isinstance(error, LinkDownError), error
    # Between the first and the last moment of the server's end.
    assert when - died[1] < AT_ONCE_S


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_that_dies_while_a_task_awaits_a_reply(kind, place):
    async def main():
        listen = place(kind)
        with served([virtual_drive("vabus", 1)], listen) as server:
            bus = drivecomm.open_bus_async(server.address)
            await bus.__aenter__()
            await bus.drive("vabus", 1).read("481", **LONG)
            asking = asyncio.create_task(bus.drive("vabus", 2, reply_timeout_s=5.0).probe())
            await asyncio.sleep(0.1)
        died = time.monotonic()
        with pytest.raises(LinkDownError):
            await asking
        assert time.monotonic() - died < AT_ONCE_S
        await bus.close()

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_a_line_that_dies_and_comes_back(kind, place):
    """The next calls open it again after a pause, and the drive is set up again before it is asked."""
    listen = place(kind)
    before = virtual_drive("vabus", 1)
    with served([before], listen) as server:
        bus = drivecomm.open_bus(server.address)
        drive = bus.drive("vabus", 1, model="agile", set_up={"481": "12.34"})
        for _ in range(5):
            assert drive.read("482").raw == "000009C4"
        assert before.peek("481", server.now()) == "000004D2"
    with pytest.raises(LinkDownError):
        drive.read("482")
    # Nobody is there: it is tried at once, and then after a pause.
    with pytest.raises(LinkError):
        drive.read("482")
    began = time.monotonic()
    with pytest.raises(LinkDownError, match="it is opened again in"):
        drive.read("482")
    assert time.monotonic() - began < 0.05
    after = virtual_drive("vabus", 1)
    with served([after], listen) as server:
        assert after.peek("481", server.now()) == "000003E8"
        readings = []
        while not readings:
            try:
                readings.append(drive.read("482"))
            except LinkError:
                assert time.monotonic() - began < 3.0
                time.sleep(0.02)
        assert time.monotonic() - began < 1.0
        assert readings[0].raw == "000009C4"
        assert after.peek("481", server.now()) == "000004D2"
        bus.close()


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_a_line_that_dies_and_comes_back_under_many_tasks(kind, place):
    async def main():
        listen = place(kind)
        first = virtual_drive("vabus", 1)
        kinds, good = set(), []
        over = asyncio.Event()
        with served([first], listen) as server:
            bus = drivecomm.open_bus_async(server.address)
            await bus.__aenter__()
            drive = bus.drive("vabus", 1, model="agile", set_up={"481": "12.34"})

            async def read_on():
                while not over.is_set():
                    try:
                        good.append((await drive.read("482")).raw)
                    except drivecomm.DriveCommError as error:
                        kinds.add(type(error))
                        await asyncio.sleep(0.01)

            tasks = [asyncio.create_task(read_on()) for _ in range(10)]
            await asyncio.sleep(0.3)
            assert good
        count = len(good)
        await asyncio.sleep(0.1)
        # All of them know, and nothing but that.
        assert kinds <= {LinkDownError, PortError}
        assert LinkDownError in kinds
        second = virtual_drive("vabus", 1)
        with served([second], listen) as server:
            until = time.monotonic() + 3
            while len(good) < count + 20:
                assert time.monotonic() < until
                await asyncio.sleep(0.02)
            over.set()
            await asyncio.gather(*tasks)
            assert second.peek("481", server.now()) == "000004D2"
            assert set(good) == {"000009C4"}
            await bus.close()

    asyncio.run(main())


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_a_line_that_dies_while_nobody_speaks(kind, place):
    async def main():
        listen = place(kind)
        with served([virtual_drive("vabus", 1)], listen) as server:
            bus = drivecomm.open_bus_async(server.address)
            await bus.__aenter__()
            drive = bus.drive("vabus", 1)
            await drive.probe()
        await asyncio.sleep(0.05)
        began = time.monotonic()
        with pytest.raises(LinkDownError):
            await drive.probe()
        assert time.monotonic() - began < AT_ONCE_S
        # A dead descriptor that is always readable must not keep the loop busy.
        processor = time.process_time()
        await asyncio.sleep(0.2)
        assert time.process_time() - processor < 0.1
        await bus.close()

    asyncio.run(main())
