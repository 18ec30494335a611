"""A whole server with all its doors in a script's event loop, over simulated lines; it can be killed and restarted."""

import asyncio
import os
import resource
import shutil
import tempfile
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Event

from clocked_lines import ClockedPlant
from small_broker import SmallBroker

import drivecomm.line.task_hosts as runner_module
import drivecomm.server.logins as logins_module
import drivecomm.server.serving as serving_module
from drivecomm.errors import UsageError
from drivecomm.plant import read_plant
from drivecomm.server import Serving, token_hash
from drivecomm.server.settings import read_settings
from drivecomm.server.supervision import kind_of_door

TOKENS = {name: f"the token of {name}, long enough" for name in ("vera", "otto", "olga")}
ROLES = {"vera": "view", "otto": "operate", "olga": "operate"}
ALL_DOORS = ("http", "mqtt", "modbus-tcp", "opcua", "sparkplug")
WATCHDOG_S = 2
PATIENCE_S = 20.0
"""Timeout of a commander's request in seconds."""
UNITS = {"pump": 1, "fan": 2, "saw": 3, "mill": 4}
# Line, drive, model, and the policy of its motor.
DRIVES = {
    "pump": ("hall", "vabus:1", "agile", "trip"),
    "fan": ("hall", "danfoss-fc:3", "fc300", "ramp"),
    "saw": ("yard", "fuji:2", "frenic", "hold"),
    "mill": ("yard", "vabus:5", "acu", "trip"),
}
MOTOR = "{ ramp_up_s = 0.2, ramp_down_s = 0.2, quick_ramp_s = 0.1, coast_s = 0.2, rated_hz = 50, maximum_hz = 50 }"
RAMPS = {"vabus": "{ }", "danfoss-fc": '{ "3-41" = 20, "3-42" = 20 }', "fuji": '{ "F07" = 20, "F08" = 20 }'}
_MAY = '["start", "reset", "reference", "reverse"]'
_LISTENS = 'listen = "tcp:127.0.0.1:0"\npaced = false'
_READY_S = 30.0
_NO_PASSWORD = logins_module.password_hash("nobody's")
_kind_of_door = cache(kind_of_door)


def plant_text(broker="mqtt://127.0.0.1:1", *, doors=ALL_DOORS, without=(), more="", listen="127.0.0.1:0"):
    """Return a plant file. without: drives to leave out. more: further keys of the server."""
    text = [f'format = 1\nserver = {{ users = "users.toml", status_period_s = 1, history = false }}\n{more}']
    text += [f'[[door]]\nkind = "{kind}"\n{_DOOR_KEYS[kind].format(broker=broker, listen=listen)}' for kind in doors]
    text += [f'[[line]]\nname = "{line}"\nport = "{line}"\n{_LISTENS}' for line in ("hall", "yard")]
    for name, (line, drive, model, policy) in DRIVES.items():
        if name in without:
            continue
        watchdog = f", watchdog_s = {WATCHDOG_S}" if policy != "hold" else ""
        text.append(
            f'[[drive]]\nname = "{name}"\nline = "{line}"\ndrive = "{drive}"\narmed = true\n'
            f'options = {{ model = "{model}" }}\nlink_loss = {{ policy = "{policy}"{watchdog} }}\n'
            'poll = [{ parameters = ["output_frequency"], period_s = 1 }]\n'
            f"motor = {MOTOR}\nvalues = {RAMPS[drive.partition(':')[0]]}\n"
            f"network = {{ {', '.join(f'{kind} = {_MAY}' for kind in doors)} }}"
        )
    return "\n".join(text) + "\n"


_DOOR_KEYS = {
    "http": 'listen = "{listen}"',
    "mqtt": 'broker = "{broker}"\nmessages = "drives"',
    "modbus-tcp": 'listen = "127.0.0.1:0"\ncommands_from = ["127.0.0.1"]\nlease_s = 1\n'
    f"units = {{{{ {', '.join(f'{name} = {unit}' for name, unit in UNITS.items())} }}}}",
    "opcua": 'listen = "127.0.0.1:0"',
    "sparkplug": 'brokers = ["{broker}"]\ngroup = "plant"\nnode = "gateway"\nrole = "operate"\nhost = "scada"',
}


class InLoopDoor:
    """Replacement of `OpenDoor` that runs the door in the loop of the core: scripts test behaviour, not threads."""

    def __init__(self, door, plant, told):
        self.door, self.opened, self.failed = door, Event(), ""
        self._plant, self._told = plant, told
        self._loop = asyncio.get_running_loop()
        self._task = asyncio.create_task(self._serve(), name=f"door {door.name}")

    def close(self):
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._task.cancel)

    async def _serve(self):
        while True:
            try:
                await self.door.run(self._plant, self.opened.set)
            except (Exception, SystemExit) as error:  # noqa: BLE001 - as in the server
                self.failed = str(error)
                self._told(f"door {self.door.name} failed: {error}")
            self.opened.clear()
            await asyncio.sleep(0.5)


async def _nothing_to_report(*_):
    pass


@contextmanager
def in_this_loop():
    """Keep servers created in this block in one event loop, on the loop's clock."""
    before = serving_module.OpenDoor, runner_module.open_timer, logins_module.password_hash, os.environ.copy()
    report_overload = serving_module.report_overload
    folder = Path(tempfile.mkdtemp(prefix="dc"))
    serving_module.OpenDoor, runner_module.open_timer = InLoopDoor, lambda: None
    # The overload report runs in another process, on the real clock.
    serving_module.report_overload = _nothing_to_report
    # No user here has a password, and computing the dummy hash takes long.
    logins_module.password_hash = lambda _: _NO_PASSWORD
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY"):
        own = folder / name[0]
        own.mkdir(mode=0o700)
        os.environ[name] = str(own)
    try:
        yield folder
    finally:
        serving_module.OpenDoor, runner_module.open_timer, logins_module.password_hash, environment = before
        serving_module.report_overload = report_overload
        os.environ.clear()
        os.environ.update(environment)
        shutil.rmtree(folder, ignore_errors=True)


class ServerBench:
    """A plant of simulated drives, and its server while it runs. doors: by kind. over: tells commanders to leave."""

    def __init__(self, folder, clocks, doors=ALL_DOORS):
        self.folder, self.clocks, self.kinds = folder, clocks, doors
        self.file = folder / "plant.toml"
        self.serving = self.plant = self.for_doors = None
        self.doors = {}
        self.broker = SmallBroker()
        self.over = False
        self.policies = {name: policy for name, (*_, policy) in DRIVES.items()}

    async def open(self):
        listed = (
            f'[[user]]\nname = "{name}"\nrole = "{ROLES[name]}"\ntoken = "{token_hash(TOKENS[name])}"\n'
            for name in TOKENS
        )
        users = self.folder / "users.toml"
        users.write_text("".join(listed))
        users.chmod(0o600)
        await self.broker.start()
        self.write_plant()
        self.plant = ClockedPlant(read_plant(self.file))
        await self.serve()

    def write_plant(self, **further):
        self.write(plant_text(self.broker.url, doors=self.kinds, **further))

    def write(self, text):
        """Write the plant file without the limits of this process, as another program would."""
        limits = {which: resource.getrlimit(which) for which in (resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE)}
        for which, (_, most) in limits.items():
            resource.setrlimit(which, (most, most))
        self.file.write_text(text)
        for which, limit in limits.items():
            resource.setrlimit(which, limit)

    async def serve(self):
        """Start the server, and return when all doors can be reached."""
        self.doors = {kind: _kind_of_door(kind)(table) for kind, table in read_settings(self.file).doors}
        self.serving = Serving(self.file, port_of=lambda line: self._open(line.name), doors=list(self.doors.values()))
        ready = asyncio.get_running_loop().create_future()
        self._running = asyncio.create_task(self.serving.run(ready.set_result), name="the server")
        async with asyncio.timeout(_READY_S):
            await asyncio.wait({ready, self._running}, return_when=asyncio.FIRST_COMPLETED)
        if not ready.done():
            await self._running
        self.for_doors = ready.result()

    async def serve_again(self):
        """Restart the server until it succeeds, as a service manager does; the disk may be full."""
        while True:
            try:
                return await self.serve()
            except (OSError, UsageError):
                await asyncio.sleep(1.0)

    def _open(self, line):
        opened = self.plant.lines[line]
        return opened.open

    async def end(self):
        """End the server as SIGTERM does."""
        self.serving.end()
        await asyncio.wait([self._running])

    async def kill(self):
        """Remove the server from one moment to the next; none of its later actions has an effect."""
        for line in self.plant.lines.values():
            line.cut()
            line.away = True
        self._running.cancel()
        await asyncio.wait([self._running])
        for line in self.plant.lines.values():
            line.away = False

    async def close(self):
        if not self._running.done():
            await self.kill()
        self.plant.close()
        await self.broker.end()
