"""Calls cancelled at every step: after each cancellation, the next exchange gets its own reply."""

import asyncio

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, Port, model_of, running, set_reference

import drivecomm
from drivecomm.virtual import VirtualLine

EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)
VERBS = {
    "read": lambda protocol, drive: drive.read(READABLE[protocol][0]),
    "write": lambda protocol, drive: drive.write(*WRITABLE[protocol][:2]),
    "start": lambda _, drive: drive.start(),
    "stop": lambda _, drive: drive.stop(),
    "status": lambda _, drive: drive.status(),
    "reference": set_reference,
}
EACH_VERB = pytest.mark.parametrize("verb", VERBS)
MOST_STEPS = 400


class Site:
    """A line with one virtual drive, and the values that the drive holds."""

    def __init__(self, protocol):
        self.protocol = protocol
        self.virtual = Mortal(protocol)
        self.line = VirtualLine([self.virtual])

    def expected(self):
        return [self.virtual.peek(parameter, self.line.time) for parameter in READABLE[self.protocol]]


# Tasks: the virtual time runner lets other tasks run between any two effects


async def cut_off(call, steps, times=1):
    """Start a call, let it make `steps` steps and cancel it; return whether it was finished before that."""
    task = asyncio.create_task(call)
    for _ in range(steps):
        await asyncio.sleep(0)
        if task.done():
            break
    over = task.done()
    for _ in range(times):
        task.cancel()
        if times > 1:
            await asyncio.sleep(0)
    try:
        await task
    except asyncio.CancelledError:
        assert not over
        return False
    return True


@pytest.mark.parametrize(("verb", "times"), [*((verb, 1) for verb in VERBS), ("read", 2), ("write", 2)])
@EACH_PROTOCOL
def test_task_cancelled_at_every_step_leaves_the_line_usable(protocol, verb, times):
    async def main():
        site = Site(protocol)
        async with drivecomm.open_bus_async(site.line.port) as bus:
            drive = bus.drive(protocol, ADDRESS, model=model_of(protocol))
            if verb in ("start", "stop"):
                await set_reference(protocol, drive)
            for steps in range(MOST_STEPS):
                if verb == "stop":
                    await drive.start()
                over = await cut_off(VERBS[verb](protocol, drive), steps, times)
                read = [(await drive.read(parameter)).raw for parameter in READABLE[protocol]]
                assert read == site.expected(), f"cancelled after {steps} steps"
                assert bus.counters[drive.name]["timeouts"] == 0, f"cancelled after {steps} steps"
                if over:
                    break
                if verb == "start":
                    before = running(site.line, site.virtual)
                    site.line.advance(1.0)
                    await drive.status()
                    await drive.read(READABLE[protocol][0])
                    site.line.advance(1.0)
                    # An unsent start is not sent later by a status request; a stop that held before may be repeated.
                    assert before or not running(site.line, site.virtual)
                    await drive.stop()
                    site.line.advance(5.0)
            assert over
            assert steps >= 4

    asyncio.run(main())


@EACH_PROTOCOL
def test_waiting_tasks_get_their_turn_after_a_cancellation(protocol):
    async def main():
        site = Site(protocol)
        async with drivecomm.open_bus_async(site.line.port) as bus:
            drive = bus.drive(protocol, ADDRESS, model=model_of(protocol))
            for steps in range(1, 12):
                parameters = [*READABLE[protocol]] * 3
                first = asyncio.create_task(VERBS["write"](protocol, drive))
                others = [asyncio.create_task(drive.read(parameter)) for parameter in parameters]
                for _ in range(steps):
                    await asyncio.sleep(0)
                first.cancel()
                others[2].cancel()
                results = await asyncio.gather(first, *others, return_exceptions=True)
                for place, result in enumerate(results[1:]):
                    if place != 2:
                        assert result.raw == site.expected()[place % 2]
                assert isinstance(results[3], asyncio.CancelledError)

    asyncio.run(main())


# Ctrl-C: the blocking runner is interrupted before or after any call of the port


class Interrupting:
    """A port that raises KeyboardInterrupt once, before or after its call number `left`."""

    def __init__(self, port, *, after):
        self._port, self._after, self.left = port, after, None

    def __getattr__(self, name):
        value = getattr(self._port, name)
        if name == "close" or not callable(value):
            return value

        def call(*arguments):
            if self.left is not None:
                self.left -= 1
            if self.left == 0 and not self._after:
                raise KeyboardInterrupt
            result = value(*arguments)
            if self.left == 0 and self._after:
                raise KeyboardInterrupt
            return result

        return call


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@EACH_VERB
@EACH_PROTOCOL
def test_ctrl_c_at_every_call_of_the_port_leaves_the_line_usable(protocol, verb, after):
    site = Site(protocol)
    port = Interrupting(site.line.port(), after=after)
    with drivecomm.open_bus(lambda: port) as bus:
        drive = bus.drive(protocol, ADDRESS, model=model_of(protocol))
        if verb in ("start", "stop"):
            set_reference(protocol, drive)
        for call in range(1, MOST_STEPS):
            port.left = call
            try:
                VERBS[verb](protocol, drive)
            except KeyboardInterrupt:
                over = False
            else:
                over = True
            port.left = None
            assert bus.line.queue.owner is None or not bus.line.queue.owner.is_alive()
            read = [drive.read(parameter).raw for parameter in READABLE[protocol]]
            assert read == site.expected(), f"interrupted at call {call}"
            assert bus.counters[drive.name]["timeouts"] == 0
            if over:
                break
            if verb == "start":
                drive.stop()
                site.line.advance(5.0)
        assert over
        assert call > 8


def test_ctrl_c_during_silence_is_not_counted_as_a_failed_call():
    virtual = Mortal("vabus")
    line = VirtualLine([virtual])

    def interrupt(until, _):
        if until > line.time:
            raise KeyboardInterrupt

    with drivecomm.open_bus(lambda: Port(line.port(), read=interrupt)) as bus:
        drive = bus.drive("vabus", ADDRESS)
        virtual.alive = False
        for _ in range(10):
            with pytest.raises(KeyboardInterrupt):
                drive.read("481")
        assert not bus.health[drive.name].given_up
