"""A server with a thousand clients, a hundred of which never read: polls and stops stay on time."""

import asyncio
import subprocess
import sys
from collections import defaultdict
from contextlib import contextmanager
from itertools import pairwise
from statistics import median

import pytest
from served_core import ENGINEER, asked, awaited, core_of, until

from drivecomm.server.http import HttpDoor
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.supervision import OpenDoor
from drivecomm.tomlfile import TomlTable

pytestmark = pytest.mark.soak

CLIENTS, DEAF = 1000, 100
PERIOD_S = 1.0
MEASURED_S = 10
STOPS = 12

LINE = """\
[[line]]
name = "{name}"
listen = "tcp:127.0.0.1:0"
baudrate = 19200
"""
DRIVE = """\
[[drive]]
name = "{line} {address}"
drive = "danfoss-fc:{address}"
line = "{line}"
armed = true
options = {{ model = "fc302" }}
poll = [{{ parameters = ["16-13", "16-14"], period_s = 1.0 }}]
"""
PLANT = "format = 1\n" + "".join(
    LINE.format(name=line) + "".join(DRIVE.format(line=line, address=address) for address in (1, 2, 3))
    for line in ("hall", "yard", "shed", "roof")
)

CROWD = """
import asyncio, sys
port, clients, deaf = map(int, sys.argv[1:])
async def come(number):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b"GET /api/v1/stream HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n")
    await reader.readuntil(b"event: hello")
    if number < deaf:
        writer.transport.pause_reading()
    return reader
async def read(reader):
    while await reader.read(1 << 16):
        pass
async def main():
    there = []
    while len(there) < clients:
        there += await asyncio.gather(*(come(len(there) + each) for each in range(20)))
    print("there", flush=True)
    await asyncio.gather(*(read(each) for each in there[deaf:]))
asyncio.run(main())
"""


class Seen:
    """Traffic of a core's lines during a period. stops: line and time of each stop request."""

    def __init__(self, core):
        self.core = core
        self.events = {name: [] for name in core.lines}
        self.stops = []

    async def listen(self, seconds):
        """Listen for a number of seconds, and stop a drive at intervals."""
        ends = [line.bus.listen(self.events[name].append) for name, line in self.core.lines.items()]
        for number in range(STOPS):
            await asyncio.sleep(seconds / STOPS)
            line = list(self.core.lines)[number % len(self.core.lines)]
            self.stops.append((line, self.core.lines[line].bus.now()))
            answer = await asked(self.core, ENGINEER, f"{line} {number % 3 + 1}", "stop")
            assert answer.outcome == "done"
        for end in ends:
            end()
        return self

    def longest_exchange_s(self):
        """Return the typical duration of the longest polled exchange, from request to end of reply, in seconds."""
        found = []
        for events in self.events.values():
            for sent, received in pairwise(events):
                if (sent.what, received.what) == ("sent", "received") and _polls(sent):
                    found.append(received.time - sent.time)
        return median(found)

    def waits_s(self):
        """Return the waiting time of each stop for its line in seconds, shortest first."""
        return sorted(
            next(each.time for each in self.events[line] if each.time >= called and _stops(each)) - called
            for line, called in self.stops
        )

    def late(self):
        """Return the lateness of each poll as a share of its period, lowest first."""
        times = defaultdict(list)
        for events in self.events.values():
            for event in events:
                if _polls(event):
                    times[id(events), event.drive, event.message.pnu].append(event.time)
        return sorted((b - a) / PERIOD_S - 1 for each in times.values() for a, b in pairwise(each))

    def late_p95(self):
        """Return the 95th percentile of the lateness of polls."""
        late = self.late()
        return late[int(0.95 * len(late))]


def _polls(event):
    return event.what == "sent" and hasattr(event.message, "pnu") and not event.message.control_word


def _stops(event):
    return event.what == "sent" and bool(event.message.control_word)


def missed(core):
    return sum(line.state().missed for line in core.lines.values())


@contextmanager
def crowd(port):
    """Run the clients in a separate process during the block."""
    command = [sys.executable, "-c", CROWD, str(port), str(CLIENTS), str(DEAF)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "there\n"
            yield
        finally:
            process.kill()


@awaited
async def test_crowd_of_clients_does_not_delay_polls_or_stops(tmp_path):
    """Compare with a run without clients; on a busy machine the measurement is repeated up to twice."""
    async with core_of(tmp_path, PLANT, status_period_s=1.0) as (core, _):
        door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
        opened = OpenDoor(door, PlantForDoors(core, "hall"), print)
        await until(lambda: all(each.reachability == "answers" for each in core.drives()), 20)
        await until(opened.opened.is_set)
        before, measured = missed(core), []
        for _ in range(3):
            calm = await Seen(core).listen(MEASURED_S)
            coming = crowd(door.port)
            await asyncio.to_thread(coming.__enter__)
            try:
                full = await Seen(core).listen(MEASURED_S)
            finally:
                await asyncio.to_thread(coming.__exit__, None, None, None)
            limit_s = calm.longest_exchange_s() + 0.02
            late, waited_s = full.late_p95(), full.waits_s()[-1]
            measured.append(
                f"late {late:.3f} of the period, alone {calm.late_p95():.3f}; a stop waited {waited_s:.4f} s"
            )
            if late < 0.05 + max(0.0, calm.late_p95()) and waited_s < limit_s:
                break
        else:
            pytest.fail("\n".join(measured))
        assert missed(core) == before
        await asyncio.to_thread(opened.close)
