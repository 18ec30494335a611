"""A thousand clients of a server, of which a hundred never read: polls keep their times, and so does a stop."""

import asyncio
import subprocess
import sys
from collections import defaultdict
from contextlib import contextmanager
from itertools import pairwise
from statistics import median

import pytest
from served import ENGINEER, asked, awaited, core_of, until

from drivecomm.server.for_doors import PlantForDoors
from drivecomm.server.http import HttpDoor
from drivecomm.server.supervision import OpenDoor
from drivecomm.tomlfile import Table

pytestmark = pytest.mark.soak

CLIENTS, DEAF = 1000, 100
PERIOD_S = 0.5
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
poll = [{{ parameters = ["16-13", "16-14"], period_s = 0.5 }}]
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
    """What went over the lines of a core for a while, by their own clocks. stops: the line and when it was asked."""

    def __init__(self, core):
        self.core = core
        self.events = {name: [] for name in core.lines}
        self.stops = []

    async def listen(self, seconds):
        """Listen for so long, and stop a drive now and then."""
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
        """How long the longest of what is polled takes mostly, from its first byte to the end of its reply."""
        found = []
        for events in self.events.values():
            for sent, received in pairwise(events):
                if (sent.what, received.what) == ("sent", "received") and _polls(sent):
                    found.append(received.time - sent.time)
        return median(found)

    def waits_s(self):
        """How long each stop waited for its line, the shortest first."""
        return sorted(
            next(each.time for each in self.events[line] if each.time >= called and _stops(each)) - called
            for line, called in self.stops
        )

    def late(self):
        """How late each poll was, as a share of its period, the least late first."""
        times = defaultdict(list)
        for events in self.events.values():
            for event in events:
                if _polls(event):
                    times[id(events), event.drive, event.message.pnu].append(event.time)
        return sorted((b - a) / PERIOD_S - 1 for each in times.values() for a, b in pairwise(each))


def _polls(event):
    return event.what == "sent" and hasattr(event.message, "pnu") and not event.message.control_word


def _stops(event):
    return event.what == "sent" and bool(event.message.control_word)


def missed(core):
    return sum(line.state().missed for line in core.lines.values())


@contextmanager
def crowd(port):
    """Let the clients come, in a process of their own."""
    command = [sys.executable, "-c", CROWD, str(port), str(CLIENTS), str(DEAF)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "there\n"
            yield
        finally:
            process.kill()


@awaited
async def test_no_poll_is_late_and_a_stop_goes_out_at_once(tmp_path):
    """Compared with the same without the clients, for what else this machine has to do."""
    async with core_of(tmp_path, PLANT, status_period_s=1.0) as (core, _):
        door = HttpDoor(Table({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
        opened = OpenDoor(door, PlantForDoors(core, "hall"), print)
        await until(lambda: all(each.reachability == "answers" for each in core.drives()), 20)
        await until(opened.opened.is_set)
        calm = await Seen(core).listen(MEASURED_S)
        coming = crowd(door.port)
        await asyncio.to_thread(coming.__enter__)
        try:
            before = missed(core)
            full = await Seen(core).listen(MEASURED_S)
            assert missed(core) == before
        finally:
            await asyncio.to_thread(coming.__exit__, None, None, None)
            await asyncio.to_thread(opened.close)
    telegram_s = calm.longest_exchange_s()
    print(f"an exchange {telegram_s:.4f} s")
    for name, seen in (("calm", calm), ("crowd", full)):
        late, waits = seen.late(), seen.waits_s()
        print(f"{name}: {len(late)} polls, late p95 {late[int(0.95 * len(late))]:.3f}, most {late[-1]:.3f}; "
              f"stops waited {waits[STOPS // 2]:.4f} s, most {waits[-1]:.4f} s")  # fmt: skip
    # What other programs of this machine take away shows in the calm as well.
    at = int(0.95 * len(full.late()))
    assert full.late()[at] < 0.05 + max(0.0, calm.late()[int(0.95 * len(calm.late()))])
    assert full.waits_s()[-2] < telegram_s + 0.02
