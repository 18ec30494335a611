"""The asynchronous bus: the same verbs as the blocking bus, and cancellation of tasks."""

import asyncio
import inspect
import threading

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, Recorder, model_of, set_reference
from two_faces import open_on

import drivecomm
from drivecomm.bus import (
    AsyncBroadcast,
    AsyncBus,
    AsyncDrive,
    Broadcast,
    Bus,
    Drive,
    LineChoices,
    open_bus,
    open_bus_async,
)
from drivecomm.errors import LinkDownError, UsageError
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
    "machine",
    "name",
    "facts",
    "peer",
    "bus",
    "capabilities",
    "parameters",
    "blocks",
    "check_read",
    "check_write",
    "may_start",
    "with_check",
    "on_engine",
    "poller",
    "to_poll_many",
    "to_status",
    "watched",
}
"""Names that return immediately on both buses; all other verbs wait for the line."""

EACH_TWIN = pytest.mark.parametrize(("blocking", "awaited"), TWINS, ids=lambda kind: kind.__name__)


def public(kind):
    """Return the public names of a class in the order of their declaration, inherited ones included."""
    found = {name: value for base in reversed(kind.__mro__) for name, value in vars(base).items() if base is not object}
    return {name: value for name, value in found.items() if not name.startswith("_")}


# Blocking and asynchronous classes are equal


@EACH_TWIN
def test_blocking_and_async_classes_have_the_same_public_names(blocking, awaited):
    assert list(public(blocking)) == list(public(awaited))
    entering = {"__enter__", "__exit__"} <= set(vars(blocking))
    assert entering == ({"__aenter__", "__aexit__"} <= set(vars(awaited)))


@EACH_TWIN
def test_blocking_and_async_methods_take_the_same_arguments(blocking, awaited):
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
def test_async_methods_are_coroutines_where_blocking_methods_wait(blocking, awaited):
    for name, function in public(awaited).items():
        waits = inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function)
        assert waits == (name not in AT_ONCE), name
        assert inspect.isasyncgenfunction(function) == inspect.isgeneratorfunction(public(blocking)[name]), name
        assert not inspect.iscoroutinefunction(public(blocking)[name])


@EACH_TWIN
def test_blocking_and_async_methods_return_the_same_types(blocking, awaited):
    for name, function in public(blocking).items():
        mine, other = (
            (each.fget if isinstance(each, property) else each).__annotations__["return"]
            for each in (function, public(awaited)[name])
        )
        # A generator has one type argument more than an asynchronous one: its return type.
        assert other.replace("Async", "") == mine.replace("Async", "").replace(", None, None]", ", None]"), name


@EACH_TWIN
def test_blocking_and_async_methods_have_docstrings(blocking, awaited):
    for kind in (blocking, awaited):
        for each in [kind, *public(kind).values()]:
            text = inspect.getdoc(each)
            assert text, (kind, each)
            assert text.splitlines()[0].endswith((".", ";"))


def test_open_bus_and_open_bus_async_take_the_same_arguments():
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


def test_drivecomm_exports_the_async_classes():
    for name in ("AsyncBus", "AsyncDrive", "AsyncBroadcast", "open_bus_async"):
        assert getattr(drivecomm, name).__name__ == name
    with pytest.raises(AttributeError, match="No drivecomm attribute AsyncNothing"):
        _ = drivecomm.AsyncNothing


# Verbs


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_blocking_and_async_drives_send_and_receive_the_same(protocol):
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
            came += [
                drive.identify(),
                *bus.scan(only=[protocol], addresses=[2, ADDRESS], choices=LineChoices(baudrates=(9600, 19200))),
            ]
            bus.broadcast(protocol).stop()
        return came, recorder.events

    assert said_and_heard("tasks") == said_and_heard("threads")


def test_async_bus_must_be_entered_before_use():
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
    """Port opener that waits until the test allows the port to open."""

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


def test_cancelled_entering_closes_the_port_that_opens_later():
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
        # The port that was opened for the cancelled call is closed again.
        assert len(slow.closed) == 1
        async with bus:
            assert (await bus.drive("vabus", ADDRESS).read("481")).raw == "000003E8"
        assert len(slow.closed) == 2

    asyncio.run(main())


def test_cancelled_reopening_of_a_lost_port_lets_the_next_call_continue():
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
