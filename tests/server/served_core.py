"""A core over virtual drives that answer in real time, and callers of the core."""

import asyncio
from contextlib import asynccontextmanager, closing, contextmanager
from functools import wraps

from drivecomm.plant import read_plant
from drivecomm.server import Caller, CommandRequest, Role
from drivecomm.server.commands import CommandExecutor
from drivecomm.server.core import Core
from drivecomm.testing import ServingThread
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
drive = "vabus:1"
line = "hall"
armed = true
options = { model = "agile" }
poll = [{ parameters = ["output_frequency"], period_s = 0.05 }]
link_loss = { policy = "trip", watchdog_s = 2 }
network = { http = ["start", "reference", "reset"], write = ["480"] }
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = { model = "fc302" }
poll = [{ parameters = ["output_frequency"], period_s = 0.05 }]
link_loss = { policy = "coast", watchdog_s = 2 }
[[drive]]
name = "mixer"
drive = "danfoss-fc:4"
line = "yard"
"""

ENGINEER = Caller(name="eva", role=Role.COMMISSION, door="local")
OPERATOR = Caller(name="otto", role=Role.OPERATE, door="http 127.0.0.1:1")
ANOTHER = Caller(name="olga", role=Role.OPERATE, door="http 127.0.0.1:1")
VIEWER = Caller(name="vera", role=Role.VIEW, door="http 127.0.0.1:1")


class NoteBook:
    """An audit that keeps its records in memory. refuses: the error to raise instead of recording, or None."""

    def __init__(self):
        self.asked_for, self.ended_with, self.stops, self.refuses = [], [], [], None

    async def record_command(self, caller, command, _lease=None):
        if self.refuses is not None:
            raise self.refuses
        self.asked_for.append((str(caller), command.drive, command.verb))
        return len(self.asked_for)

    def record_stop(self, _caller, command):
        self.stops.append((command.drive, command.arguments.get("how", "ramp")))
        return 0

    def refused(self, _caller, command, why):
        self.ended_with.append((command.drive, command.verb, f"refused: {why}"))

    def outcome(self, _caller, command, _number, answer):
        self.ended_with.append((command.drive, command.verb, answer.outcome))


@contextmanager
def simulated(plant):
    """Serve the virtual drives of a plant; yield the server and the control of the drives."""
    server = PlantServer(VirtualPlant(plant), control="127.0.0.1:0")
    with closing(ServingThread(server)), ControlClient(server.control) as control:
        yield server, control


@asynccontextmanager
async def core_of(tmp_path, text=PLANT, *, audit=None, status_period_s=0.05, **further):
    """Yield a core of this plant, and the control of its virtual drives."""
    file = tmp_path / "plant.toml"
    file.write_text(text)
    plant = read_plant(file)
    with simulated(plant) as (server, control):
        core = Core(
            plant,
            session="this run",
            audit=audit or NoteBook(),
            status_period_s=status_period_s,
            **{
                "port_of": lambda line: (
                    f"socket://{server.addresses[line.name].partition('://')[2] or server.addresses[line.name]}"
                ),
                **further,
            },
        )
        async with core:
            yield core, control


def runs(control, name):
    """Return whether the motor of a virtual drive turns or is about to, regardless of reported states."""
    return next(each for each in control.order("show")["drives"] if each["name"] == name)["running"]


async def until(condition, seconds=5.0):
    """Wait until a condition is true. Raises TimeoutError."""
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 - any condition
            await asyncio.sleep(0.005)


async def asked(core, caller, drive, verb, **further):
    """Carry out a command, and return its result."""
    return await CommandExecutor(core).carry_out(caller, CommandRequest(drive=drive, verb=verb, **further))


def awaited(test):
    """Decorate a test that is a coroutine function, so that it runs in a new event loop."""

    @wraps(test)
    def run(*values, **options):
        asyncio.run(test(*values, **options))

    return run
