"""What concerns motors, awaited: stops that overtake and always ask, commands that are not repeated."""

import asyncio

import pytest
from benches import ADDRESS, Mortal, Port, Recorder, running

import drivecomm
from drivecomm.errors import LinkDownError, OvertakenError, UsageError
from drivecomm.virtual import VirtualLine


def commands_and_questions(recorder):
    """Return the parameters that were written or asked for, in order."""
    return [event.message.parameter for event in recorder.sent() if event.message.kind in ("select", "enquiry")]


@pytest.mark.parametrize("everybody", [False, True])
def test_a_stop_overtakes_what_waits(everybody):
    line, recorder = VirtualLine([Mortal("vabus"), Mortal("vabus", 4)]), Recorder()

    async def program():
        async with drivecomm.open_bus_async(line.port, trace=recorder) as bus:
            drive, other = bus.drive("vabus", ADDRESS), bus.drive("vabus", 4)
            stop = bus.broadcast("vabus").stop if everybody else drive.stop
            calls = (drive.probe(), other.polled("480"), other.read("481"), stop())
            return await asyncio.gather(*calls, return_exceptions=True)

    overtaken, *others = asyncio.run(program())
    assert isinstance(overtaken, OvertakenError), "it had its turn, and had sent nothing yet"
    assert not any(isinstance(each, Exception) for each in others)
    asked = commands_and_questions(recorder)
    assert asked == ([] if everybody else [412]) + [410, 481, 480]


def test_a_write_overtakes_readings():
    line, recorder = VirtualLine([Mortal("vabus")]), Recorder()

    async def program():
        async with drivecomm.open_bus_async(line.port, trace=recorder) as bus:
            drive = bus.drive("vabus", ADDRESS, model="agile")
            await asyncio.gather(drive.probe(), drive.polled("480"), drive.read("482"), drive.write("481", 1))

    asyncio.run(program())
    assert commands_and_questions(recorder)[1:] == [481, 482, 480]


def test_reverse_is_backwards():
    virtual = Mortal("danfoss-fc")
    line = VirtualLine([virtual])

    async def program():
        async with drivecomm.open_bus_async(line.port) as bus:
            drive = bus.drive("danfoss-fc", ADDRESS)
            await drive.set_reference(percent=50)
            await drive.reverse()

    asyncio.run(program())
    line.advance(20)
    assert running(line, virtual)
    assert virtual.motor.output_hz == pytest.approx(-25, abs=0.1)


def test_stored_writes_are_counted():
    line = VirtualLine([Mortal("vabus")])

    async def program():
        async with drivecomm.open_bus_async(line.port) as bus:
            drive = bus.drive("vabus", ADDRESS, model="agile")
            for value in range(10):
                await drive.write("481", value, store=True)
            with pytest.raises(UsageError, match="481 of vabus:3 was stored 10 times within an hour"):
                await drive.write("481", 1, store=True)

    asyncio.run(program())


def test_a_run_command_is_not_repeated_after_the_port_was_lost_and_the_lost_one_is_closed():
    virtual, closed = Mortal("danfoss-fc"), []
    line = VirtualLine([virtual])

    def port():
        return Port(line.port(), close=lambda: closed.append(line.time))

    async def program():
        async with drivecomm.open_bus_async(port) as bus:
            drive = bus.drive("danfoss-fc", ADDRESS)
            await drive.set_reference(percent=50)
            await drive.start()
            line.broken = True
            with pytest.raises(LinkDownError):
                await drive.status()
            assert len(closed) == 1
            line.broken = False
            virtual.heard.clear()
            line.advance(1)
            await drive.status()
            await drive.read("3-10[3]")

    asyncio.run(program())
    assert len(virtual.heard) >= 2
    assert all(not message.control_word & 1 << 10 for _, message in virtual.heard)
