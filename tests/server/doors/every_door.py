"""A plant with every kind of door open, among them the one of the page "Write a door"; its records and motors."""

import asyncio
import sys
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module, invalidate_caches

from mosquitto import mosquitto
from pages import ROOT, blocks_of
from served_core import NoteBook, core_of, runs

from drivecomm.errors import LeaseError
from drivecomm.server import Users, token_hash
from drivecomm.server.history import HistoryWriter
from drivecomm.server.history_service import HistoryService
from drivecomm.server.http import HttpDoor
from drivecomm.server.modbus_tcp import modbus_tcp_door
from drivecomm.server.mqtt import mqtt_door
from drivecomm.server.opcua import OpcuaDoor
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.sparkplug import SparkplugDoor
from drivecomm.server.supervision import OpenDoor
from drivecomm.tomlfile import TomlTable

PAGE = ROOT / "docs" / "development" / "write-a-door.md"
KINDS = ("http", "lines", "modbus-tcp", "mqtt", "opcua", "sparkplug")
GROUP, NODE, HOST = "works", "gateway", "scada"
UNITS = {"pump": 1, "fan": 2, "mixer": 3}
TOKENS = {"vera": "view", "otto": "operate"}

_ALLOWED = ", ".join(f'{kind} = ["start", "reference"]' for kind in KINDS)
_DRIVE = """\
[[drive]]
name = "{name}"
drive = "{drive}"
line = "{line}"
armed = {armed}
options = {{ model = "{model}" }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.1 }}]
link_loss = {{ policy = "{policy}", watchdog_s = 2 }}
network = {{ {network} }}
"""
PLANT = (
    'format = 1\n[[line]]\nname = "hall"\nlisten = "tcp:127.0.0.1:0"\npaced = false\n'
    '[[line]]\nname = "yard"\nlisten = "tcp:127.0.0.1:0"\npaced = false\n'
    + _DRIVE.format(
        name="pump", drive="vabus:1", line="hall", armed="true", model="agile", policy="trip", network=_ALLOWED
    )
    + _DRIVE.format(
        name="fan", drive="danfoss-fc:3", line="yard", armed="true", model="fc302", policy="coast", network=""
    )
    + _DRIVE.format(
        name="mixer", drive="danfoss-fc:4", line="yard", armed="false", model="fc302", policy="coast", network=_ALLOWED
    )
)
"""Every door may start the pump, none may start the fan, and the mixer is not armed."""


class Audit(NoteBook):
    """An audit that can delay the record of a command, and thereby its sending."""

    def __init__(self):
        super().__init__()
        self.waiting = threading.Event()
        self._free = threading.Event()
        self._free.set()

    async def record_command(self, caller, command, lease=None):
        if not self._free.is_set():
            self.waiting.set()
            await asyncio.to_thread(self._free.wait, 30)
        return await super().record_command(caller, command, lease)

    @contextmanager
    def held(self):
        """Block the recording of commands during the block."""
        self.waiting.clear()
        self._free.clear()
        try:
            yield
        finally:
            self._free.set()

    def refused_of(self, drive):
        """Return the refused commands of a drive as pairs of verb and reason."""
        return [(verb, what) for name, verb, what in self.ended_with if name == drive and what.startswith("refused")]

    def forget(self):
        """Clear all records."""
        for noted in (self.asked_for, self.ended_with, self.stops):
            noted.clear()
        self.refuses = None


class Hall:
    """The plant and its doors. doors: the doors by their kinds. broker: the broker of the MQTT and Sparkplug doors."""

    def __init__(self):
        self.audit, self.doors, self.broker = Audit(), {}, None
        self.core = self.control = self.plant = self.loop = None

    def runs(self, drive="pump"):
        """Return whether the motor of the virtual drive turns, regardless of any reported state."""
        return runs(self.control, drive)

    def asked(self, work):
        """Run a coroutine in the core's event loop, and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(20)

    def answers(self, drive="pump"):
        """Return whether a drive answers the server."""
        return self.plant.drive(drive).reachability == "answers"

    def answers_for_a_while(self, drive="pump", seconds=1):
        """Wait until a drive has answered for this number of seconds."""
        until(lambda: self.answers(drive))
        seen = self.plant.drive(drive).answered_s
        until(lambda: (self.plant.drive(drive).answered_s or 0) > seen + seconds)

    def rest(self):
        """Stop the pump, and wait until all leases are released."""
        for lease in self.plant.leases():
            # The door may have released the lease meanwhile.
            with suppress(LeaseError):
                self.asked(self.plant.end_lease(lease.holder, lease.drive, lease.key))
        until(self.answers)
        self.asked(self.core.lines["hall"].drive("pump").stop())
        until(lambda: not (self.runs() or self.plant.leases() or self.core.kept.policy("pump")))
        until(lambda: self.plant.drive("pump").standing_stop is None)
        self.audit.forget()


def until(condition, seconds=15.0):
    """Wait until a condition is true, and return its value."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.01)
    return found


@contextmanager
def hall_of(folder):
    """Serve the plant through all doors; yield it."""
    hall, ready, over = Hall(), threading.Event(), threading.Event()
    history = folder / "history.sqlite"

    async def serve():
        journal = HistoryWriter(history)
        try:
            async with core_of(folder, PLANT, audit=hall.audit, journal=journal, status_period_s=0.1) as (
                core,
                control,
            ):
                hall.core, hall.control, hall.loop = core, control, asyncio.get_running_loop()
                hall.plant = PlantForDoors(core, "hall", users=_users(folder), history=HistoryService(history))
                ready.set()
                await asyncio.to_thread(over.wait)
        finally:
            journal.close()

    with ExitStack() as stack:
        hall.broker = stack.enter_context(mosquitto(folder / "broker"))
        thread = threading.Thread(target=asyncio.run, args=(serve(),))
        thread.start()
        stack.callback(thread.join, 20)
        stack.callback(over.set)
        assert ready.wait(20)
        for kind, door in _doors(hall.broker.url, stack.enter_context(_of_the_page(folder / "page"))).items():
            opened = OpenDoor(door, hall.plant, print)
            stack.callback(opened.close)
            assert opened.opened.wait(60), opened.failed
            hall.doors[kind] = door
        until(lambda: all(map(hall.answers, UNITS)))
        yield hall


def _doors(broker, lines_door):
    def table(kind, **content):
        return TomlTable({"kind": kind, **content}, "plant.toml", name="door 1")

    here = {"listen": "127.0.0.1:0"}
    return {
        "http": HttpDoor(table("http", **here)),
        "lines": lines_door(table("lines", **here)),
        "modbus-tcp": modbus_tcp_door(table("modbus-tcp", **here, units=UNITS, commands_from=["127.0.0.1"], lease_s=1)),
        "mqtt": mqtt_door(table("mqtt", broker=broker)),
        "opcua": OpcuaDoor(table("opcua", **here)),
        "sparkplug": SparkplugDoor(
            table("sparkplug", broker=broker, group=GROUP, node=NODE, host=HOST, role="operate")
        ),
    }


def _users(folder):
    file = folder / "users.toml"
    file.write_text(
        "".join(
            f'[[user]]\nname = "{name}"\nrole = "{role}"\ntoken = "{token_hash(token_of(name))}"\n'
            for name, role in TOKENS.items()
        )
    )
    file.chmod(0o600)
    return Users(file)


def token_of(name):
    """Return the token of a user."""
    return f"a token of {name}'s own, long enough"


@contextmanager
def _of_the_page(folder):
    """Yield the factory of the door on the page, as its entry point names it."""
    for block in blocks_of(PAGE):
        if block.title.endswith(".py"):
            place = folder / block.title
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(block.code, encoding="utf-8")
    sys.path.insert(0, str(folder))
    invalidate_caches()
    try:
        yield import_module("drivecomm_lines").lines_door
    finally:
        sys.path.remove(str(folder))
        for name in [each for each in sys.modules if each.partition(".")[0] == "drivecomm_lines"]:
            del sys.modules[name]
