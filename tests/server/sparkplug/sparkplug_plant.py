"""A served plant of virtual drives with a Sparkplug door, run as in the server, and messages from hosts."""

import asyncio
import json
import time
from contextlib import asynccontextmanager
from types import SimpleNamespace

from served_core import core_of

from drivecomm.server import cancel_and_wait
from drivecomm.server.history import HistoryWriter
from drivecomm.server.history_service import HistoryService
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.sparkplug import SparkplugDoor
from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encode_payload
from drivecomm.tomlfile import TomlTable

GROUP, NODE, HOST = "plant", "gateway", "scada"

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
drive = "vabus:1"
line = "hall"
armed = true
options = { model = "agile" }
poll = [{ parameters = ["output_frequency", "output_current"], period_s = 0.05 }]
link_loss = { policy = "trip", watchdog_s = 2 }
network = { sparkplug = ["start", "reference", "reset"] }
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = { model = "fc302" }
poll = [{ parameters = ["output_frequency"], period_s = 0.05 }]
link_loss = { policy = "coast", watchdog_s = 2 }
"""


def door_of(*urls, **keys):
    """Return a door to these brokers."""
    said = {"brokers": list(urls), "group": GROUP, "node": NODE, "role": "operate", "keep_alive_s": 2, **keys}
    return SparkplugDoor(TomlTable(said, "plant.toml", name="door 1"))


@asynccontextmanager
async def gateway(tmp_path, door, text=PLANT, *, journal=True):
    """Serve a plant by a door; yield its core, the control of its drives, its door's task and its audit."""
    file = tmp_path / "history.sqlite"
    kept = HistoryWriter(file) if journal else None
    try:
        async with core_of(tmp_path, text, journal=kept) as (core, control):
            plant = PlantForDoors(core, "hall 2", history=HistoryService(file) if journal else None)
            opened = asyncio.Event()
            served = SimpleNamespace(core=core, control=control, plant=plant, opened=opened, door=door)
            served.begin = lambda: _begin(served)
            _begin(served)
            try:
                yield served
            finally:
                await end(served.task)
    finally:
        if kept is not None:
            kept.close()


def _begin(served):
    served.task = asyncio.create_task(served.door.run(served.plant, served.opened.set))


async def end(task):
    """Shut down a door in an orderly way."""
    await cancel_and_wait(task)


def state(*, online, time_ms=None):
    """Return the payload of a primary host's state message."""
    return json.dumps({"online": online, "timestamp": round(time.time() * 1000) if time_ms is None else time_ms})


def command(name="", value=None, kind=None, *, alias=None, age_s=0.0, timed=True, more=(), uuid=""):
    """Return the payload of a command with one or more metrics."""
    metrics = [Metric(name=name, alias=alias, type=kind or _KINDS[type(value)], value=value), *more]
    time_ms = round((time.time() - age_s) * 1000) if timed else None
    return encode_payload(Payload(metrics=tuple(metrics), time_ms=time_ms, uuid=uuid), say_types=True)


_KINDS = {bool: DataType.BOOLEAN, float: DataType.DOUBLE, int: DataType.INT32, str: DataType.STRING}

REBIRTH = ("Node Control/Rebirth", True)
