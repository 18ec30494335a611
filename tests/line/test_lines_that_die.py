"""Lines that die and return, for both kinds of bus: a call reports it immediately, a later one reopens the line."""

import asyncio
import time
from contextlib import suppress

import pytest
from two_faces import each_face, open_on

import drivecomm
from drivecomm.errors import LinkDownError, LinkError, PortError
from drivecomm.virtual import virtual_drive

AT_ONCE_S = 0.2
each_kind = pytest.mark.parametrize("kind", ["pty", "tcp"])


@each_face
@each_kind
def test_call_reports_immediately_that_its_line_dies(face, kind, host_of):
    """The drive would have five seconds to answer."""
    host = host_of(kind, virtual_drive("vabus", 1))
    with open_on(face, host.address) as bus:
        bus.drive("vabus", 1, model="agile").read("481")
        silent = bus.drive("vabus", 2, reply_timeout_s=5.0)
        host.server.line.monitors.append(lambda _: host._stop.set())
        with pytest.raises(LinkDownError):
            silent.probe()
        raised_at = time.monotonic()
        host.end()
    assert raised_at - host.died_at < AT_ONCE_S


@each_face
@each_kind
def test_call_reports_immediately_that_its_idle_line_has_died(face, kind, host_of):
    host = host_of(kind, virtual_drive("vabus", 1))
    with open_on(face, host.address) as bus:
        drive = bus.drive("vabus", 1)
        drive.probe()
        host.end()
        began, processor = time.monotonic(), time.process_time()
        # A dead descriptor that is always readable must not keep an event loop busy.
        bus.sleep_until(bus.now() + 0.2)
        assert time.process_time() - processor < 0.1
        with pytest.raises(LinkDownError, match=r"was lost .* the next exchange opens it again"):
            drive.probe()
        assert time.monotonic() - began < 0.2 + AT_ONCE_S


@pytest.mark.soak
@each_face
@pytest.mark.parametrize("kind", ["pty", "tcp", "rfc2217"])
def test_returned_line_is_reopened_after_a_pause_and_its_drive_set_up_again(face, kind, host_of):
    host = host_of(kind, virtual_drive("vabus", 1))
    with open_on(face, host.address) as bus:
        drive = bus.drive("vabus", 1, model="agile", set_up={"481": "12.34"})
        assert drive.read("482").raw == "000009C4"
        host.end()
        with pytest.raises(LinkDownError):
            drive.read("482")
        # With no server there, the port is tried immediately, and again after a pause.
        with pytest.raises(PortError, match=r"does not exist|nothing listens there"):
            drive.read("482")
        began = time.monotonic()
        with pytest.raises(LinkDownError, match="it is opened again in"):
            drive.read("482")
        assert time.monotonic() - began < 0.05
        host.begin(after := virtual_drive("vabus", 1))
        assert after.peek("481", host.server.now()) == "000003E8"
        value = None
        while value is None:
            assert time.monotonic() - began < 3.0
            with suppress(LinkError):
                value = drive.read("482").raw
            bus.sleep_until(bus.now() + 0.02)
        assert value == "000009C4"
        assert after.peek("481", host.server.now()) == "000004D2"


@pytest.mark.soak
@each_kind
def test_line_dies_and_returns_under_many_tasks(kind, host_of):
    host, kinds, good, over = host_of(kind, virtual_drive("vabus", 1)), set(), [], asyncio.Event()

    async def read_on(drive):
        while not over.is_set():
            try:
                good.append((await drive.read("482")).raw)
            except drivecomm.DriveCommError as error:
                kinds.add(type(error))
                await asyncio.sleep(0.01)

    async def more_than(count):
        end = time.monotonic() + 5
        while len(good) <= count:
            assert time.monotonic() < end, "nothing is read"
            await asyncio.sleep(0.01)

    async def main():
        async with drivecomm.open_bus_async(host.address) as bus:
            drive = bus.drive("vabus", 1, model="agile", set_up={"481": "12.34"})
            tasks = [asyncio.create_task(read_on(drive)) for _ in range(10)]
            await more_than(20)
            await asyncio.to_thread(host.end)
            await asyncio.sleep(0.1)
            # All tasks get these errors, and no others.
            assert LinkDownError in kinds <= {LinkDownError, PortError}
            host.begin(second := virtual_drive("vabus", 1))
            await more_than(len(good) + 20)
            over.set()
            await asyncio.gather(*tasks)
            assert second.peek("481", host.server.now()) == "000004D2"
            assert set(good) == {"000009C4"}

    asyncio.run(main())
