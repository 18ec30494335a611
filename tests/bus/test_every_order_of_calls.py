"""A stopped motor stays stopped until a caller starts it: calls in every order, in virtual time.

The first call runs on the line; at one of its steps (any call of the port) the second is made, from another thread or
task, and at a step of either the third. All steps are tried. A stop by another master, a dip of the mains and a lost
port count as calls, too. Whatever the calls return, the motor must stand at the end if the last command was a stop; and
a call that only reads must not make it run.
"""

import asyncio
import contextlib
import itertools
import random
import threading
import time
from functools import cache

import pytest
from addresses import address_of
from benches import COMMANDED
from extents import LONG, protocol_extents

import drivecomm
from drivecomm.bus import open_bus_async
from drivecomm.errors import DriveError, LinkError, ReplyError, UsageError
from drivecomm.link import PortProxy
from drivecomm.protocol import Framed, Stop, installed
from drivecomm.virtual import VirtualLine, drive_type

PROTOCOLS = COMMANDED
READABLE = {
    "vabus": "411",
    "danfoss-fc": "16-13",
    "vlt3500": "215",
    "fuji": "M09",
    "modbus": "16130",
    "uss": "1082",
    "huanyang": "CFG1",
    "mitsubishi": "H6F",
    "movilink": "8300",
    "hitachi": "03-1",
    "ls-bus": "0x0009",
    "ct-ansi": "02.01",
    "toshiba": "FD00",
}
SET_UP = {
    "vabus": {"481": 7},
    "danfoss-fc": {"3-41": 5},
    "vlt3500": {"215": 6},
    "fuji": {"S05": 20},
    "modbus": {"3410": 5},
    "uss": {"1082": 20},
    "huanyang": {"CFG0": 20},
    "mitsubishi": {"HED": 20},
    "movilink": {"8470": 3},
    "hitachi": {"F002": 20},
    "ls-bus": {"0x0007": 20},
    "ct-ansi": {"01.14": 0},
    "toshiba": {"0012": 40},
}
MOST_STEPS = 40

STARTS = ("start", "start by another object")
STOPS = ("stop", "stop by another object", "stop all")
ASKS = ("read", "status", "status by another object", "reference", "function", "set-up", "lost port")
OUTSIDE = ("another master's stop", "dip")
REPEATS = ("status", "status by another object", "reference", "function")
"""Calls that may repeat a command, right after a status that allows it."""
HAPPENS = (*OUTSIDE, "lost port")
CALLS = (*STARTS, *STOPS, *ASKS, *OUTSIDE)


@cache
def kind_of_drive(protocol):
    return drive_type(protocol, address_of(protocol, 3), options={})


class SteppedPort(PortProxy):
    """A port of a virtual line that calls `step` before each operation; outside events never occur within one."""

    def __init__(self, port, step, alone):
        super().__init__(port)
        self._step = step
        self._alone = alone

    def configure(self, settings):
        with self._alone:
            self._step()
            return self._port.configure(settings)

    def write(self, data):
        with self._alone:
            self._step()
            self._port.write(data)

    def read(self, until, at_least):
        with self._alone:
            self._step()
            return self._port.read(until, at_least)

    def wait(self, until):
        with self._alone:
            self._step()
            self._port.wait(until)


class Story:
    """Calls in order and their ends, and the resulting expectation about the motor."""

    def __init__(self, running):
        self.events = ["start called", "start done"] if running else []
        self.repeating = 0

    def called(self, name):
        self.repeating += name in REPEATS
        self.events.append(f"{kind_of(name)} called")
        return len(self.events) - 1

    def done(self, name, place):
        self.over(name)
        self.events.append(f"{kind_of(name)} done")
        if kind_of(name) == "stop":
            self.events[place] = "confirmed stop called"

    def over(self, name):
        self.repeating -= name in REPEATS

    def happened(self):
        """Record an event outside; it is invisible between a status and the command that the status allows."""
        self.events.append("outside, unseen" if self.repeating else "outside done")

    @property
    def must_stand(self):
        """Whether a stop was called after the last start; an outside event counts at the moment when it occurs."""
        started = max((at for at, event in enumerate(self.events) if event == "start called"), default=-1)
        finished = max((at for at, event in enumerate(self.events) if event == "start done"), default=-1)
        stopped = max((at for at, event in enumerate(self.events) if event == "confirmed stop called"), default=-1)
        outside = max((at for at, event in enumerate(self.events) if event == "outside done"), default=-1)
        open_start = started > finished
        return started < 0 or stopped > started or (outside > max(started, finished) and not open_start)


def refusals(name):
    """Return the errors that a call may raise.

    A function of the control word is refused unless its caller commands the drive already.
    """
    return (DriveError, LinkError, ReplyError, *([UsageError] if name == "function" else []))


def kind_of(name):
    return "start" if name in STARTS else "stop" if name in STOPS else "outside" if name in OUTSIDE else "asking"


class Scene:
    """A virtual drive on a line, and another master that stops it at some steps."""

    def __init__(self, protocol, step):
        self.protocol = protocol
        self.virtual = kind_of_drive(protocol).new()
        # A stop shows in the status immediately; the packages themselves test the status of a motor that ramps down.
        self.virtual.motor.ramp_down_s = 0.0
        self.line = VirtualLine([self.virtual])
        self.step = step
        self.alone = threading.RLock()

    def port(self):
        return SteppedPort(self.line.port(), self.next_step, self.alone)

    def next_step(self):
        self.step()

    def another_masters_stop(self):
        if self.line.broken:
            # Bytes under way when the port was lost arrive before another master sends.
            self.line.advance(0.1)
        plugin = drivecomm.protocol.installed[self.protocol]
        kind = kind_of_drive(self.protocol)
        exchange = plugin.operations(kind.address, kind.options, kind.model).stop(Stop.RAMP)
        command = next(exchange)
        while command is not None:
            request = command.message
            data = self.virtual.codec.encode(request)
            reply = self.virtual.hear(Framed(data, self.virtual.codec.decode(data, "request")), self.line.time)
            try:
                message = None if reply is None else self.virtual.codec.decode(reply.data, "reply")
                command = exchange.send(message)
            except StopIteration:
                return

    def happen(self, name):
        if name == "another master's stop":
            self.another_masters_stop()
        elif name == "dip":
            self.line.power_off(self.virtual)
            self.line.power_on(self.virtual)
        else:
            self.line.broken = True

    def runs(self):
        self.line.broken = False
        self.line.advance(60)
        self.virtual.motor.advance(self.line.time)
        return self.virtual.motor.running or self.virtual.motor.output_hz > 0


def objects(bus, protocol):
    """Return three objects for the drive; the last one has a set-up to write after an absence."""
    kind = kind_of_drive(protocol)
    first, second = (bus.drive(protocol, kind.address, model=kind.model) for _ in range(2))
    return first, second, bus.drive(protocol, kind.address, model=kind.model, set_up=SET_UP[protocol])


def set_reference(protocol, drive):
    percent = protocol in ("danfoss-fc", "vlt3500", "modbus", "movilink", "uss")
    return drive.set_reference(**({"percent": 50} if percent else {"hz": 25}))


def switch_a_function(protocol, drive):
    """Switch a function that is sent in the same telegram as the run command."""
    if protocol in ("vabus", "modbus"):
        return drive.status()
    if protocol == "fuji":
        return drive.call("terminals", X1=True)
    return drive.select_setup(1)


def everybody(bus, protocol, third):
    """Return an object that stops all drives; another object for the drive if the protocol has no broadcast."""
    if installed[protocol].broadcast_address is None:
        return third
    return bus.broadcast(protocol, model=kind_of_drive(protocol).model)


def verbs(protocol, first, second, third, everybody):
    """Return the calls on these objects for the drive; a call may have to be awaited."""
    return {
        "start": first.start,
        "start by another object": second.start,
        "stop": first.stop,
        "stop by another object": second.stop,
        "stop all": everybody.stop,
        "read": lambda: first.read(READABLE[protocol]),
        "status": first.status,
        "status by another object": second.status,
        "reference": lambda: set_reference(protocol, first),
        "function": lambda: switch_a_function(protocol, first),
        "set-up": lambda: third.read(READABLE[protocol]),
    }


AFTERWARDS = ("read", "status", "status by another object", "set-up")


def by_threads(protocol, running, plan):
    """Carry out a plan of (call, step of the call); return the story, whether the motor runs, and the steps taken."""
    waiting = list(plan)
    taken = [0]
    threads = []

    def step():
        scene.line.broken = False
        while waiting and waiting[0][1] <= taken[0]:
            begin(waiting.pop(0)[0])
        taken[0] += 1

    def begin(name):
        if name in HAPPENS:
            with scene.alone:
                scene.happen(name)
                if name in OUTSIDE:
                    story.happened()
            return
        place = story.called(name)

        def work():
            try:
                calls[name]()
            except refusals(name):
                story.over(name)
                return
            finally:
                over.set()
            story.done(name, place)

        over, queued = threading.Event(), len(bus.line.queue.waiting)
        threads.append(threading.Thread(target=work))
        threads[-1].start()
        # A call that waits for the line has begun; with the line free, it ends immediately.
        until = time.monotonic() + 10
        while not over.is_set() and len(bus.line.queue.waiting) <= queued:
            assert time.monotonic() < until
            time.sleep(0)

    def the_next():
        with scene.alone:
            if not waiting:
                return None
            name, at = waiting.pop(0)
            taken[0] = max(taken[0], at)
            return name

    scene = Scene(protocol, lambda: None)
    with drivecomm.open_bus(scene.port) as bus:
        first, second, third = objects(bus, protocol)
        set_reference(protocol, first)
        if running:
            first.watched(60)
            first.start()
            first.status()
        calls = verbs(protocol, first, second, third, everybody(bus, protocol, third))
        story = Story(running)
        name, _ = waiting.pop(0)
        scene.step = step
        place = story.called(name)
        try:
            calls[name]()
        except refusals(name):
            story.over(name)
        else:
            story.done(name, place)
        steps = taken[0]
        while name := the_next():
            begin(name)
        for thread in threads:
            thread.join(10)
            assert not thread.is_alive()
        scene.step = lambda: None
        scene.line.broken = False
        for name in AFTERWARDS:
            with contextlib.suppress(*refusals(name)):
                calls[name]()
        return story, scene.runs(), steps


def by_tasks(protocol, running, plan):
    return asyncio.run(_by_tasks(protocol, running, plan))


async def _by_tasks(protocol, running, plan):
    waiting = list(plan)
    taken = [0]
    tasks = []

    def step():
        scene.line.broken = False
        while waiting and waiting[0][1] <= taken[0]:
            begin(waiting.pop(0)[0])
        taken[0] += 1

    def begin(name):
        if name in HAPPENS:
            scene.happen(name)
            if name in OUTSIDE:
                story.happened()
        else:
            tasks.append(asyncio.create_task(carry_out(name, story.called(name))))

    async def carry_out(name, place):
        try:
            await calls[name]()
        except refusals(name):
            story.over(name)
            return
        story.done(name, place)

    scene = Scene(protocol, lambda: None)
    async with open_bus_async(scene.port) as bus:
        first, second, third = objects(bus, protocol)
        await set_reference(protocol, first)
        if running:
            first.watched(60)
            await first.start()
            await first.status()
        calls = verbs(protocol, first, second, third, everybody(bus, protocol, third))
        story = Story(running)
        name, _ = waiting.pop(0)
        scene.step = step
        await carry_out(name, story.called(name))
        steps = taken[0]
        while waiting:
            taken[0] = max(taken[0], waiting[0][1])
            begin(waiting.pop(0)[0])
        while not all(task.done() for task in tasks):
            await asyncio.gather(*tasks)
        scene.step = lambda: None
        scene.line.broken = False
        for name in AFTERWARDS:
            with contextlib.suppress(*refusals(name)):
                await calls[name]()
        return story, scene.runs(), steps


def check(face, protocol, running, plan):
    story, runs, steps = face(protocol, running, plan)
    assert not (runs and story.must_stand), (protocol, "running" if running else "standing", plan, story.events)
    return steps


def worth_trying(names, running):
    """Return whether a call stops the motor, and another call could make it run."""
    kinds = {kind_of(name) for name in names}
    return kinds & {"stop", "outside"} and (running or "start" in kinds)


@pytest.mark.soak
@pytest.mark.parametrize("face", [by_threads, by_tasks])
@pytest.mark.parametrize("running", [False, True], ids=["standing", "running"])
@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 37, 1 if LONG else 3))
def test_motor_stays_stopped_after_two_calls_in_every_order(protocol, running, face, extent):
    """All orders; a sample takes every n-th step."""
    tried, chance = 0, random.Random(protocol)
    for names in itertools.product(CALLS, repeat=2):
        if names[0] in HAPPENS or not worth_trying(names, running):
            continue
        # Threads are slow to begin, so only some of their steps are tried; tasks go through all steps.
        every = extent * (1 if LONG or face is by_tasks else chance.randrange(2, 5))
        for at in range(chance.randrange(every), MOST_STEPS, every):
            tried += 1
            if check(face, protocol, running, [(names[0], 0), (names[1], at)]) <= at:
                break
    assert tried > 50 / extent


@pytest.mark.parametrize("face", [by_threads, by_tasks])
@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 15, 20_000 if LONG else 150))
def test_motor_stays_stopped_after_three_calls_in_random_orders(protocol, face, extent):
    chance = random.Random(protocol)
    for _ in range(extent):
        running = chance.random() < 0.5
        names = [chance.choice(CALLS) for _ in range(3)]
        if names[0] in HAPPENS or not worth_trying(names, running):
            continue
        places = sorted(chance.randrange(12) for _ in range(2))
        check(face, protocol, running, [(names[0], 0), (names[1], places[0]), (names[2], places[1])])
