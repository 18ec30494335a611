"""A core over virtual drives with an OPC UA door, and clients of that door."""

import asyncio
from contextlib import asynccontextmanager
from functools import cache, partial

from asyncua import Client, ua

from drivecomm.plant import read_plant
from drivecomm.server import Users, password_hash, token_hash
from drivecomm.server.alarms import PlantAlarms, read_alarms
from drivecomm.server.core import Core
from drivecomm.server.history import HistoryWriter
from drivecomm.server.history_service import HistoryService
from drivecomm.server.opcua import OpcuaDoor
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.settings import read_settings
from drivecomm.server.supervision import OpenDoor
from drivecomm.testing import ServingThread
from drivecomm.tomlfile import TomlTable
from drivecomm.virtual import ControlClient, PlantServer, VirtualPlant

PLANT = """\
format = 1
[[line]]
name = "hall"
listen = "tcp:127.0.0.1:0"
paced = false
[[line]]
name = "yard"
listen = "tcp:127.0.0.1:0"
paced = false
[[drive]]
name = "pump"
title = "feed pump"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = { model = "fc302" }
poll = [{ parameters = ["output_frequency", "3-41"], period_s = 0.05 }]
link_loss = { policy = "ramp", watchdog_s = 2 }
network = { opcua = ["start", "reference", "reset"], write = ["3-41"] }
[[drive]]
name = "fan"
drive = "vabus:1"
line = "hall"
armed = true
options = { model = "agile" }
poll = [{ parameters = ["output_frequency", "output_current", "maximum_frequency"], period_s = 0.05 }]
link_loss = { policy = "trip", watchdog_s = 2 }
"""

PASSWORDS = {"vera": "view-1234", "otto": "operate-1234", "olga": "operate-5678", "carl": "commission-1234"}
ROLES = {"vera": "view", "otto": "operate", "olga": "operate", "carl": "commission"}
TOKEN = "a token of otto's own, long enough"


@cache
def hashes_of_passwords():
    """Return the password hashes of the users file; computing them is slow by design."""
    return {name: password_hash(password) for name, password in PASSWORDS.items()}


class NoteBook:
    """An audit that keeps its records in memory."""

    def __init__(self):
        self.asked_for, self.refusals, self.stops = [], [], []

    async def record_command(self, caller, command, _lease=None):
        self.asked_for.append((caller.name, caller.door_kind, command.drive, command.verb, dict(command.arguments)))
        return len(self.asked_for)

    def record_stop(self, caller, command):
        self.stops.append((caller.name, command.drive, command.arguments.get("how")))
        return 0

    def refused(self, _caller, command, why):
        self.refusals.append((command.drive, command.verb, why))

    def outcome(self, *_):
        pass


class Opened:
    """An open door. core, control: of the plant behind it. alarms: the alarms of the plant, None without alarms."""

    def __init__(self, door, core, control, plant, users):
        self.door, self.core, self.control, self.plant, self.users = door, core, control, plant, users
        self.told = []

    @property
    def url(self):
        return f"opc.tcp://127.0.0.1:{self.door.port}/"

    @asynccontextmanager
    async def client(self, name="", password=None):
        client = Client(self.url, timeout=20)
        if name:
            client.set_user(name)
            client.set_password(PASSWORDS[name] if password is None else password)
        async with client:
            yield client

    def state(self, name):
        """Return the real state of a virtual drive."""
        return next(each for each in self.control.order("show")["drives"] if each["name"] == name)

    def runs(self, name):
        return self.state(name)["running"]


@asynccontextmanager
async def opened(tmp_path, text=PLANT, *, users=True, history=False, reached=True, **table):
    """Serve a plant of virtual drives with an OPC UA door in a separate thread; yield both.

    reached: whether virtual drives answer on the ports of the lines.
    """
    file = tmp_path / "plant.toml"
    file.write_text(text)
    plant = read_plant(file)
    listed = tmp_path / "users.toml"
    if users:
        hashes = hashes_of_passwords()
        listed.write_text(
            "".join(
                f'[[user]]\nname = "{name}"\nrole = "{ROLES[name]}"\npassword = "{hashes[name]}"\n'
                + (f'token = "{token_hash(TOKEN)}"\n' if name == "otto" else "")
                for name in PASSWORDS
            )
        )
        listed.chmod(0o600)
    server = PlantServer(VirtualPlant(plant), control="127.0.0.1:0")
    thread = ServingThread(server)
    journal = HistoryWriter(tmp_path / "history.sqlite", 30, 100, tell=print) if history else None
    door = OpcuaDoor(TomlTable({"kind": "opcua", "listen": "127.0.0.1:0", **table}, "plant.toml", name="door 1"))
    settings = read_settings(file)
    rules = read_alarms(settings.alarms, plant.drives, settings.backups.drives)
    watched = watching = alarms = None
    try:
        with ControlClient(server.control) as control:
            core = Core(
                plant, session="this run", audit=NoteBook(), journal=journal, status_period_s=0.05,
                port_of=lambda line: (
                    f"socket://{server.addresses[line.name].partition('://')[2]}" if reached else "socket://127.0.0.1:1"
                ),
            )  # fmt: skip
            async with core:
                served = PlantForDoors(
                    core, "hall 2", users=Users(listed) if users else None,
                    history=HistoryService(tmp_path / "history.sqlite") if history else None,
                )  # fmt: skip
                if rules:
                    loop = asyncio.get_running_loop()
                    alarms = PlantAlarms(
                        served, rules, file=tmp_path / "alarms.json",
                        write_event=lambda *said, **more: loop.call_soon_threadsafe(
                            partial(core.table.record_event, *said, **more)
                        ),
                    )  # fmt: skip
                    served.set_alarms(alarms)
                    watching = OpenDoor(alarms, served, print)
                one = Opened(door, core, control, served, listed)
                one.alarms = alarms
                watched = OpenDoor(door, served, one.told.append)
                assert await asyncio.to_thread(watched.opened.wait, 60), watched.failed
                await until(lambda: not reached or all(each.reachability == "answers" for each in core.drives()))
                one.watched = watched
                yield one
                await asyncio.to_thread(watched.close)
                if watching is not None:
                    await asyncio.to_thread(watching.close)
    finally:
        for each in (watched, watching):
            if each is not None:
                await asyncio.to_thread(each.close)
        if journal is not None:
            journal.close()
        thread.close()


async def until(condition, seconds=20.0):
    """Wait until a condition, which may be awaitable, is true. Raises TimeoutError."""
    async with asyncio.timeout(seconds):
        while True:
            found = condition()
            if await found if asyncio.iscoroutine(found) else found:
                return
            await asyncio.sleep(0.01)


class ReceivedValues(list):
    """Values that a subscription of asyncua received, oldest first; also the handler of the subscription."""

    def datachange_notification(self, _node, value, _data):
        """Append a value."""
        self.append(value)


def node(client, *parts):
    """Return a node of the plant's namespace by the parts of its id."""
    return client.get_node(ua.NodeId("/".join(parts), 2))


async def data(client, *parts):
    """Return the value of a node with its status, whatever the status is."""
    return await node(client, *parts).read_data_value(raise_on_bad_status=False)


async def reads_good(client, *parts):
    """Wait until a node has a good value, since on a busy machine late polls make values stale for a moment."""

    async def is_good():
        return (await data(client, *parts)).StatusCode.is_good()

    await until(is_good)


async def call(client, method, *arguments, on="drives/pump", to=None):
    """Call a method; return the name of its status, and its output arguments."""
    request = ua.CallMethodRequest(
        ObjectId=ua.NodeId(on, 2), MethodId=to or ua.NodeId(f"methods/{method}", 2),
        InputArguments=[each if isinstance(each, ua.Variant) else ua.Variant(each) for each in arguments],
    )  # fmt: skip
    (result,) = await client.uaclient.call([request])
    return result.StatusCode.name, [each.Value for each in result.OutputArguments or []]


async def lock(client, drive="pump"):
    """Lock a drive, and check that the lock is granted."""
    status, (number, text) = await call(client, "InitLock", "a test", on=f"drives/{drive}/Lock")
    assert (status, number) == ("Good", 0), text
