"""A core over virtual drives with a Modbus TCP door, in separate threads, and a PLC that writes to it cyclically."""

import asyncio
import threading
import time
from contextlib import contextmanager

from raw_master import Master, Refused, float_words, until
from served_core import PLANT, NoteBook, core_of, runs

from drivecomm.server.modbus_tcp import modbus_tcp_door
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.supervision import OpenDoor
from drivecomm.tomlfile import TomlTable

STOP, HEARTBEAT, SEQUENCE, COMMAND, KIND, REFERENCE = 1000, 1001, 1002, 1003, 1004, 1006
START, BACKWARDS, RESET, AGAIN = 1, 2, 3, 4
UNDER_WAY, DONE, REFUSED, FAILED, OPEN = 1, 2, 3, 4, 5
NO_COMMAND, STOP_IS_ON, NO_LEASE, BUSY, NOT_ALLOWED, READ_ONLY = 1, 2, 3, 4, 5, 6
NOBODY, MINE, ANOTHER = 0, 1, 2

ALLOWED = PLANT.replace('network = { http = ["start", "reference", "reset"]', "network = { modbus-tcp = [{verbs}]")
ALLOWED = ALLOWED.replace(
    'policy = "coast", watchdog_s = 2 }', 'policy = "coast", watchdog_s = 2 }\nnetwork = { modbus-tcp = ["reset"] }'
)
assert ALLOWED.count("modbus-tcp") == 2
VERBS = '"start", "reference", "reset"'


class Gateway:
    """Objects of the core's thread. notes: its audit. plant: the plant as doors see it."""

    def __init__(self):
        self.notes = NoteBook()
        self.door = self.plant = self.core = self.control = self.loop = None
        self.opened = None

    def open_door(self, **content):
        said = {
            "listen": "127.0.0.1:0",
            "units": {"pump": 1, "fan": 2, "mixer": 3},
            "commands_from": ["127.0.0.1"],
            "lease_s": 1,
        }
        self.door = modbus_tcp_door(TomlTable({**said, **content}, "hall.toml", name="door 1"))
        self.opened = OpenDoor(self.door, self.plant, print)
        assert self.opened.opened.wait(5)

    def master(self, unit=1):
        return Master(self.door.port, unit)

    def runs(self, drive="pump"):
        return runs(self.control, drive)

    def verbs(self):
        """Return the verbs of the commands sent to the drives, without stops."""
        return [verb for _, _, verb in self.notes.asked_for]

    def asked(self, work):
        """Run a coroutine in the core's event loop, and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(10)


@contextmanager
def gateway(folder, *, verbs=VERBS, **content):
    """Yield a gateway, as soon as its drives answer."""
    found, ready, over = Gateway(), threading.Event(), threading.Event()

    async def serve():
        text = ALLOWED.replace("{verbs}", verbs)
        async with core_of(folder, text, audit=found.notes, status_period_s=0.2) as (core, control):
            found.core, found.control, found.loop = core, control, asyncio.get_running_loop()
            found.plant = PlantForDoors(core, "hall")
            ready.set()
            while not over.is_set():  # noqa: ASYNC110 - set by another thread
                await asyncio.sleep(0.01)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    try:
        assert ready.wait(20)
        found.open_door(**content)
        until(lambda: all(each.reachability == "answers" for each in found.plant.drives()))
        yield found
    finally:
        if found.opened is not None:
            found.opened.close()
        over.set()
        thread.join(20)


class Plc:
    """A PLC that writes the whole register block in each cycle.

    Its attributes are the fields of the block in the PLC's memory.
    """

    def __init__(self, master):
        self.master = master
        self.stop = self.heartbeat = self.sequence = self.command = self.kind = 0
        self.reference = 0.0

    def write(self):
        """Write the block unchanged."""
        words = (self.stop, self.heartbeat, self.sequence, self.command, self.kind, 0, *float_words(self.reference))
        self.master.write(STOP, *words)

    def cycle(self):
        """Write the block with the next heartbeat."""
        self.heartbeat = self.heartbeat % 65535 + 1
        self.write()

    def state(self):
        """Return the state word of the drive; 0 while it is not current."""
        try:
            return self.master.read(1, 1)[0]
        except Refused:
            return 0

    def frequency(self):
        """Return the output frequency in Hz; NaN while it is not current."""
        try:
            return self.master.float(8)
        except Refused:
            return float("nan")

    def results(self):
        return Results(*self.master.read(1008, 8))

    def cycles_until(self, condition, seconds=10.0):
        """Repeat cycles until a condition is true, and return its value."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, self.results()
            self.cycle()
            time.sleep(0.02)
        return found

    def cycles_for(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.cycle()
            time.sleep(0.02)

    def take_lease(self):
        self.cycles_until(lambda: self.results().lease == MINE)

    def give(self, command, **fields):
        """Acquire the lease, give a command, and return its results."""
        self.take_lease()
        for name, value in fields.items():
            setattr(self, name, value)
        self.command, self.sequence = command, self.sequence + 1
        return self.answered()

    def answered(self):
        """Wait for the results of the command just given, and return them."""

        def told():
            results = self.results()
            return results if results.answered == self.sequence and results.outcome > UNDER_WAY else None

        return self.cycles_until(told)


class Results:
    def __init__(self, *words):
        self.answered, self.outcome, self.reason, self.lease, self.lease_left = words[:5]
        self.reference_outcome, self.reference_reason, self.stop_outcome = words[5:]

    def __repr__(self):
        return str(vars(self))
