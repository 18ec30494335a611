"""A fake plant, and doors that serve it in separate threads, as the server runs them."""

import asyncio
import contextlib
import http.client
import json
import socket
import threading
import time
from collections import deque
from decimal import Decimal
from types import SimpleNamespace

from drivecomm.client import parsed
from drivecomm.errors import LeaseError, NotAllowedError, UsageError
from drivecomm.link import Statistics
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig, DriveState as Motion, DriveStatus, Reading, Stop
from drivecomm.server import (
    Caller,
    CommandAnswer,
    CurrentValue,
    DoorSnapshot,
    DriveSnapshot,
    Event,
    Lease,
    LineSnapshot,
    PastValue,
    Role,
    Stopped,
)

STARTED_S = 1_700_000_000.0


def counted(reply_s, counters):
    statistics = Statistics()
    statistics.counters.update(counters)
    statistics.reply_times.add(reply_s)
    return statistics


class FakeChanges:
    """Changes of the fake plant, merged per value as in the server."""

    def __init__(self, plant):
        self._plant = plant
        self._loop = asyncio.get_running_loop()
        self._wake = asyncio.Event()
        self._values, self._events = {}, []
        self.lost = 0

    def put(self, values, events):
        self._loop.call_soon_threadsafe(self._put, values, events)

    def _put(self, values, events):
        self._values.update({(each.drive, each.name): each for each in values})
        self._events += events
        self._wake.set()

    async def __aiter__(self):
        while True:
            await self._wake.wait()
            self._wake.clear()
            values, events = list(self._values.values()), self._events
            self._values, self._events = {}, []
            yield values, events

    def close(self):
        self._plant.listeners.discard(self)


class FakeUsers:
    """Users anna (view), otto (operate) and carl (commission); each token is the name written twice."""

    def __init__(self):
        self.roles = {"anna": Role.VIEW, "otto": Role.OPERATE, "carl": Role.COMMISSION}
        self.asked = 0

    def caller(self, token, door):
        name = token[: len(token) // 2]
        if name + name != token or name not in self.roles:
            raise NotAllowedError("this token is not known")
        return Caller(name=name, role=self.roles[name], door=door)

    async def log_in(self, name, password):
        self.asked += 1
        if password != f"{name}'s password":
            raise NotAllowedError("the name or the password is wrong")
        return SimpleNamespace(token=name + name, until_s=time.time() + 3600)


class FakeHistory:
    def __init__(self):
        self.asked = []
        self.count, self.taken = 2, -1
        self.ended = threading.Event()

    async def points(self, drive, name, from_s, to_s, points):
        self.asked.append((drive, name, from_s, to_s, points))
        return [(from_s, 10.5, "good"), (to_s, None, "bad")]

    async def pieces(self, drive, name, from_s, to_s):
        self.asked.append((drive, name, from_s, to_s))
        if name == "unread":
            raise UsageError(f"there is no 'unread' of {drive}")
        try:
            for number in range(self.count):
                yield [PastValue(row=number, time_s=from_s + number, drive=drive, name=name, value=Decimal("10.50"))]
                self.taken = number
        finally:
            self.ended.set()

    async def events(self, *, drive, kind, from_s, to_s, limit):
        self.asked.append((drive, kind, from_s, to_s, limit))
        return [Event(number=7, time_s=STARTED_S, kind="fault", text="overcurrent", drive="pump")]


def reading(value="10.00", name="output_frequency", unit="Hz", *, note="", text="", time_s=None):
    return Reading(
        parameter="481", value=Decimal(value), raw=1000, unit=unit, name=name, note=note, text=text,
        time_s=time.time() if time_s is None else time_s,
    )  # fmt: skip


def value(drive="pump", name="output_frequency", amount="10.00", unit="Hz", *, quality="good", **more):
    found = None if quality in ("bad", "stale") else reading(amount, name, unit, **more)
    return CurrentValue(drive=drive, name=name, reading=found, quality=quality, time_s=time.time())


class FakePlant:
    name = "hall 2"
    session = "blue-otter-17"
    started_s = STARTED_S

    def __init__(self, drives=("pump", "fan"), users=None, history=None, polled=("output_frequency",)):
        configs = tuple(
            DriveConfig(protocol="vabus", address=number % 30 + 1, name=name, line="main", title=f"the {name}")
            for number, name in enumerate(drives)
        )
        self.plant = Plant(lines=(PlantLine(name="main", port="/dev/null"),), drives=configs, file="hall.toml")
        self.users, self.history = users, history
        self.states = {
            each.name: DriveSnapshot(config=each, line="main", reachability="answers", answered_s=time.time(),
                                  status=DriveStatus(word=0x0F07, state=Motion.RUNNING, running=True, fault=False),
                                  statistics=counted(0.012, {"requests": 12, "framing errors": 1}))
            for each in configs
        }  # fmt: skip
        self.current = {(name, each): value(name, each) for name in drives for each in polled}
        self.happened = deque(maxlen=100)
        self.listeners = set()
        self.commands, self.stops, self.acted = [], [], []
        self.answers = {}
        self.held = {}
        self.line_states = [LineSnapshot(name="main", port="/dev/ttyUSB0", up=True, polls=100, missed=2)]
        self.door_states = [
            DoorSnapshot(name="http 127.0.0.1:8080", up=True, clients=3),
            DoorSnapshot(name="mqtt broker:8883", up=False, backlog_rows=120),
        ]
        self.pending_alarms = [{"id": "pump-fault", "drive": "pump", "text": "overcurrent"}]
        self.waiting = threading.Event()
        self.cancelled = threading.Event()

    def answering(self):
        return {name for name, state in self.states.items() if state.reachability == "answers"}

    def standing_stops(self):
        return {}

    def drives(self):
        return list(self.states.values())

    def drive(self, name):
        return self.states[self.plant.drive(name).name]

    def values(self):
        return list(self.current.values())

    def value(self, drive, name):
        return self.current.get((drive, name))

    def lines(self):
        return self.line_states

    def doors(self):
        return self.door_states

    def events(self):
        return list(self.happened)

    def changes(self, every_s=0.0):  # noqa: ARG002 - reports every change immediately
        changes = FakeChanges(self)
        self.listeners.add(changes)
        return changes

    def leases(self):
        return list(self.held.values())

    def may(self, caller, drive):
        self.plant.drive(drive)
        return ["read", "stop"] if caller.role < Role.OPERATE else ["read", "stop", "start"]

    def alarms(self):
        return self.pending_alarms

    def alarm_rules(self):
        return []

    async def acknowledge(self, caller, alarm):
        found = [each for each in self.pending_alarms if each["id"] == alarm]
        if not found:
            raise UsageError(f"there is no alarm {alarm!r}")
        return {**found[0], "acknowledged_by": caller.name}

    async def command(self, caller, command):
        self.commands.append((caller, command))
        if command.verb == "break":
            raise RuntimeError("secret inside")
        if command.verb == "wait":
            self.waiting.set()
            try:
                await asyncio.sleep(30)
            except asyncio.CancelledError:
                self.cancelled.set()
                raise
        if command.id and (caller.name, command.id) in self.answers:
            return self.answers[caller.name, command.id]
        lease = self.held.get(command.drive)
        error = None
        if command.session and command.session != self.session:
            error = NotAllowedError("the command was meant for an earlier run of the server")
        elif caller.role < Role.OPERATE and command.verb not in ("read", "stop"):
            error = NotAllowedError(f"{caller} may not")
        elif command.lease and (lease is None or lease.key != command.lease):
            error = LeaseError("the lease is over")
        if error:
            answer = CommandAnswer(id=command.id, outcome="refused", error=error)
        else:
            self.acted.append(command.verb)
            answer = CommandAnswer(id=command.id, outcome="done", result=reading() if command.verb == "read" else None)
        self.answers[caller.name, command.id] = answer
        return answer

    async def stop_all(self, caller, how, lines=()):
        self.stops.append((caller, how, tuple(lines)))
        return [
            Stopped(line="main", drive=name, how=Stop(how), answer=CommandAnswer(id="", outcome="done"))
            for name in self.states
        ]

    def hold_stop(self, _caller, _drive, _how):
        return lambda: None

    async def take_lease(self, caller, drive, seconds):
        if drive in self.held and self.held[drive].holder != caller:
            raise LeaseError(f"{self.held[drive].holder} commands {drive} now")
        lease = self.held[drive] = Lease(
            drive=drive, holder=caller, until_s=time.time() + seconds, key=f"key of {drive}"
        )
        return lease

    async def renew_lease(self, caller, drive, key, seconds):
        if drive not in self.held or self.held[drive].key != key:
            raise LeaseError("the lease is over")
        return await self.take_lease(caller, drive, seconds)

    async def end_lease(self, caller, drive, key):
        await self.renew_lease(caller, drive, key, 1)
        del self.held[drive]

    async def kept_events(self, _caller, drive):
        for number in range(3):
            yield {"done": number == 2, "text": f"{drive} {number}"}

    async def examine(self, _caller, line, what, choices):
        if choices.get("only") == ["nonsense"]:
            raise UsageError("there is no protocol 'nonsense'")
        yield {"line": line, "what": what, "choices": dict(choices)}

    def change(self, *values, events=()):
        """Publish changed values and new events."""
        self.current.update({(each.drive, each.name): each for each in values})
        self.happened.extend(events)
        for each in list(self.listeners):
            each.put(values, list(events))

    def event(self, number, text="it tripped", drive="pump"):
        return Event(number=number, time_s=time.time(), kind="fault", text=text, drive=drive)


@contextlib.contextmanager
def served(door, plant):
    """Run a door in a thread with its own event loop; yield its state, whose `end` stops it."""
    opened, found = threading.Event(), SimpleNamespace(error=None, ended_s=None, loop=None)

    async def run():
        found.loop, found.task = asyncio.get_running_loop(), asyncio.current_task()
        await door.run(plant, opened.set)

    def in_thread():
        try:
            asyncio.run(run())
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # noqa: BLE001 - the test checks the exception
            found.error = error
        opened.set()

    def end():
        began = time.monotonic()
        with contextlib.suppress(RuntimeError):
            found.loop.call_soon_threadsafe(found.task.cancel)
        thread.join(10)
        assert not thread.is_alive(), "the door does not end"
        found.ended_s = time.monotonic() - began

    thread = threading.Thread(target=in_thread, daemon=True)
    thread.start()
    assert opened.wait(10)
    if found.error:
        raise found.error
    found.end = end
    try:
        yield found
    finally:
        if thread.is_alive():
            end()
    if found.error:
        raise found.error


class Client:
    """Client of one door, over TCP or its unix socket."""

    def __init__(self, door, token="", **headers):
        self._door = door
        self.headers = {"Authorization": f"Bearer {token}"} if token else {}
        self.headers |= headers

    def connect(self):
        if isinstance(self._door, (str, bytes)) or hasattr(self._door, "parts"):
            connected = socket.socket(socket.AF_UNIX)
            connected.settimeout(10)
            connected.connect(str(self._door))
            return connected
        return socket.create_connection(("127.0.0.1", self._door.port), timeout=10)

    def ask(self, method, path, body=None, raw=None, **headers):
        connection = http.client.HTTPConnection("localhost")
        connection.sock = self.connect()
        data = raw if raw is not None else None if body is None else json.dumps(body).encode()
        connection.request(method, path, data, {**self.headers, **headers})
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        if answer.getheader("Content-Type", "").endswith("json") and content and b"\n" not in content:
            content = parsed(content)
        return SimpleNamespace(status=answer.status, content=content, headers=answer.headers)

    def get(self, path, **headers):
        return self.ask("GET", path, **headers)

    def post(self, path, **body):
        return self.ask("POST", path, body)

    @contextlib.contextmanager
    def stream(self, query="", **headers):
        connected = self.connect()
        lines = [f"GET /api/v1/stream{query} HTTP/1.1", "Host: localhost"]
        lines += [f"{name}: {each}" for name, each in {**self.headers, **headers}.items()]
        connected.sendall("\r\n".join([*lines, "", ""]).encode())
        source = EventSource(connected)
        try:
            yield source
        finally:
            source.close()


class EventSource:
    """Messages of an event stream, one by one."""

    def __init__(self, connected):
        self.socket = connected
        self._file = connected.makefile("rb")
        status = self._file.readline()
        self.status = int(status.split()[1])
        while self._file.readline().strip():
            pass
        self._text = b""

    def close(self):
        self._file.close()
        self.socket.close()

    def line(self):
        return self._file.readline()

    def next(self, kind=None):
        """Return name, content and id of the next message, or of the next one of this kind."""
        while True:
            while b"\n\n" not in self._text:
                size = self._file.readline()
                if not size or not (length := int(size, 16)):
                    raise EOFError
                self._text += self._file.read(length)
                self._file.read(2)
            message, _, self._text = self._text.partition(b"\n\n")
            fields = dict(line.split(": ", 1) for line in message.decode().splitlines() if line and line[0] != ":")
            if "event" in fields and kind in (None, fields["event"]):
                return SimpleNamespace(name=fields["event"], data=parsed(fields["data"]), id=fields.get("id"))
