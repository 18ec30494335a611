"""The bus for callers that await: the same verbs as the other one, and what only tasks can do to it."""

import asyncio
import inspect
import threading
import time
from functools import partial

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, Recorder, model_of, set_reference
from two_faces import open_on

import drivecomm
from drivecomm.bus import AsyncBroadcast, AsyncBus, AsyncDrive, Broadcast, Bus, Drive, open_bus, open_bus_async
from drivecomm.errors import LinkDownError, UsageError
from drivecomm.line import Job, OwnThreadHost, VirtualTimeHost, task_host_for
from drivecomm.protocol import Pause
from drivecomm.virtual import VirtualLine

TASKS = 200

TWINS = [(Bus, AsyncBus), (Drive, AsyncDrive), (Broadcast, AsyncBroadcast)]
AT_ONCE = {
    "read_only_reason",
    "storing",
    "member",
    "questions",
    "with_stop_notice",
    "kept_in_ram",
    "in_ram_only",
    "other_master",
    "drive",
    "poll",
    "broadcast",
    "command",
    "now",
    "real_time",
    "wall_time",
    "counters",
    "statistics",
    "health",
    "listen",
    "name",
    "facts",
    "peer",
    "bus",
    "capabilities",
    "blocks",
    "check_read",
    "check_write",
    "may_start",
    "checked",
    "on_engine",
    "poller",
    "to_poll_many",
    "to_status",
    "watched",
}
"""What returns at once on both faces; all else waits for the line."""

EACH_TWIN = pytest.mark.parametrize(("blocking", "awaited"), TWINS, ids=lambda kind: kind.__name__)


def public(kind):
    """Return what a face offers by name, in the order of its declaration, be it its own or shared."""
    found = {name: value for base in reversed(kind.__mro__) for name, value in vars(base).items() if base is not object}
    return {name: value for name, value in found.items() if not name.startswith("_")}


# Both faces are equal


@EACH_TWIN
def test_both_have_the_same_names(blocking, awaited):
    assert list(public(blocking)) == list(public(awaited))
    entering = {"__enter__", "__exit__"} <= set(vars(blocking))
    assert entering == ({"__aenter__", "__aexit__"} <= set(vars(awaited)))


@EACH_TWIN
def test_both_take_the_same_arguments(blocking, awaited):
    for name in ["__init__", *public(blocking)]:
        mine, other = (inspect.getattr_static(kind, name) for kind in (blocking, awaited))
        assert isinstance(mine, property) == isinstance(other, property), name
        if isinstance(mine, property):
            continue
        parameters = [
            [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]
            for function in (mine, other)
        ]
        assert parameters[0] == parameters[1], name


@EACH_TWIN
def test_one_awaits_where_the_other_blocks(blocking, awaited):
    for name, function in public(awaited).items():
        waits = inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function)
        assert waits == (name not in AT_ONCE), name
        assert inspect.isasyncgenfunction(function) == inspect.isgeneratorfunction(public(blocking)[name]), name
        assert not inspect.iscoroutinefunction(public(blocking)[name])


@EACH_TWIN
def test_both_return_the_same(blocking, awaited):
    for name, function in public(blocking).items():
        mine, other = (
            (each.fget if isinstance(each, property) else each).__annotations__["return"]
            for each in (function, public(awaited)[name])
        )
        # A generator has one type more than an asynchronous one: what it returns.
        assert other.replace("Async", "") == mine.replace("Async", "").replace(", None, None]", ", None]"), name


@EACH_TWIN
def test_both_say_what_they_do(blocking, awaited):
    for kind in (blocking, awaited):
        for each in [kind, *public(kind).values()]:
            text = inspect.getdoc(each)
            assert text, (kind, each)
            assert text.splitlines()[0].endswith((".", ";"))


def test_both_are_opened_by_the_same_arguments():
    mine, other = (
        [
            (each.name, each.kind, each.default, each.annotation)
            for each in inspect.signature(function).parameters.values()
        ]
        for function in (open_bus, open_bus_async)
    )
    assert mine == other
    assert open_bus.__doc__
    assert open_bus_async.__doc__


def test_the_public_face_has_both():
    for name in ("AsyncBus", "AsyncDrive", "AsyncBroadcast", "open_bus_async"):
        assert getattr(drivecomm, name).__name__ == name
    with pytest.raises(AttributeError, match="No drivecomm attribute AsyncNothing"):
        _ = drivecomm.AsyncNothing


# Verbs


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_both_send_the_same_and_get_the_same(protocol):
    def said_and_heard(face):
        recorder, parameter = Recorder(), WRITABLE[protocol][0]
        with open_on(face, VirtualLine([Mortal(protocol)]).port, trace=recorder) as bus:
            drive = bus.drive(protocol, ADDRESS, model=model_of(protocol), set_up={parameter: 1})
            drive.probe()
            came = [drive.read(each) for each in READABLE[protocol]]
            drive.write(*WRITABLE[protocol][:2])
            set_reference(protocol, drive)
            drive.start()
            came += [drive.polled(parameter), drive.status()]
            drive.stop()
            came += [drive.identify(), *bus.scan(only=[protocol], addresses=[2, ADDRESS, 4])]
            bus.broadcast(protocol).stop()
        return came, recorder.events

    assert said_and_heard("tasks") == said_and_heard("threads")


def test_it_must_be_entered():
    async def main():
        bus = open_bus_async(VirtualLine([Mortal("vabus")]).port)
        drive = bus.drive("vabus", ADDRESS)
        with pytest.raises(UsageError, match="this bus is not open; use it in `async with`"):
            await drive.probe()
        with pytest.raises(UsageError):
            bus.now()
        async with bus:
            await drive.probe()

    asyncio.run(main())


# Opening and closing


class Slow:
    """Opens a port when it is allowed to."""

    def __init__(self, line):
        self.line = line
        self.opening = threading.Event()
        self.go_on = threading.Event()
        self.closed = []

    def __call__(self):
        self.opening.set()
        assert self.go_on.wait(10)
        port = self.line.port()
        port.close = lambda: self.closed.append(port)
        return port


def test_cancelled_while_the_port_is_being_opened():
    async def main():
        slow = Slow(VirtualLine([Mortal("vabus")]))
        bus = open_bus_async(slow)
        entering = asyncio.create_task(bus.__aenter__())
        await asyncio.to_thread(slow.opening.wait, 10)
        entering.cancel()
        with pytest.raises(asyncio.CancelledError):
            await entering
        slow.go_on.set()
        for _ in range(200):
            if slow.closed:
                break
            await asyncio.sleep(0.005)
        # What was opened for nobody is closed again.
        assert len(slow.closed) == 1
        async with bus:
            assert (await bus.drive("vabus", ADDRESS).read("481")).raw == "000003E8"
        assert len(slow.closed) == 2

    asyncio.run(main())


def test_cancelled_while_a_lost_port_is_being_opened_again():
    async def main():
        line = VirtualLine([Mortal("vabus")])
        slow = Slow(line)
        slow.go_on.set()
        async with open_bus_async(slow) as bus:
            drive = bus.drive("vabus", ADDRESS)
            await drive.probe()
            line.broken = True
            with pytest.raises(LinkDownError):
                await drive.probe()
            line.broken = False
            slow.opening.clear()
            slow.go_on.clear()
            reading = asyncio.create_task(drive.read("481"))
            waiting = asyncio.create_task(drive.read("482"))
            await asyncio.to_thread(slow.opening.wait, 10)
            reading.cancel()
            with pytest.raises(asyncio.CancelledError):
                await reading
            slow.go_on.set()
            assert (await waiting).raw == "000009C4"
            assert bus.line.queue.owner is None or not bus.line.queue.owner.is_alive()

    asyncio.run(main())


# A thread for ports that only block


class Blocking:
    """A port in real time that only blocks: a virtual line whose time passes at the pace of the world."""

    paced = True
    real_time = True
    descriptor = None

    def __init__(self, line):
        self._port = line.port()
        self._line = line
        self.calls = []

    def _follow(self, until):
        while (left := until - self._line.time) > 0:
            step = min(left, 0.002)
            time.sleep(step)
            self._line.advance(step)

    def now(self):
        return self._line.time

    def wall_time(self):
        return self._line.time

    def configure(self, settings):
        self.calls.append(threading.current_thread().name)
        return self._port.configure(settings)

    def write(self, data):
        self._port.write(data)

    def read(self, until, at_least):
        came = b""
        while True:
            came += self._port.read(self._line.time, 1)
            if len(came) >= at_least or self._line.time >= until:
                return came
            self._follow(min(until, self._line.time + 0.002))

    def take(self):
        return self._port.read(self._line.time, 1)

    def hold_back(self, at_least):
        pass

    def wait(self, until):
        self._follow(until)

    def close(self):
        pass


def test_the_runner_suits_the_port():
    async def main():
        line = VirtualLine([])
        assert isinstance(task_host_for(line.port()), VirtualTimeHost)
        runner = task_host_for(Blocking(line))
        assert isinstance(runner, OwnThreadHost)
        runner.close()

    asyncio.run(main())


def test_a_port_that_blocks_holds_nobody_up():
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
def test_a_thread_is_stopped_when_its_task_is_cancelled(after_s, times):
    """Its request is on the wire, is waited for, or is being answered, by the line's own clock."""

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


def test_a_thread_that_lets_time_pass_is_stopped_when_its_task_is_cancelled():
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
