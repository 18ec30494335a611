"""Growth of a server in six hours: a plant of 500 drives on 50 lines with four values of each a second.

    python benchmarks/endurance_of_a_server.py [--hours 6] [--polled] [--lines 50] [--drives 10] [--trace]

The server is complete: core, local and HTTP door, history, audit and alarms. Its clients come and go, never read,
command drives, and lose their leases. Its lines are virtual, with a time of their own:

    fed       43 million values are put into the table of current values as fast as the history writes them; no line
              is polled. Each value changes; some are bad, and drives fall silent and trip.
    polled    (--polled) the lines are polled on virtual drives whose time passes as quickly as possible. That makes
              some four thousand reads a second, so use fewer drives: --lines 4.

Prints a line of JSON at each of 24 points: resident memory, objects, values, bytes of the history's files. --trace
prints the allocations since the first quarter at the end (tracemalloc).
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import os
import random
import socket
import sys
import time
import tracemalloc
from contextlib import suppress
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.client import LocalServer, server_of_plant
from drivecomm.errors import DriveCommError, PortError
from drivecomm.line import STATUS
from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue, Serving
from drivecomm.virtual import VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Callable

POLLED = ("16-13", "16-14", "16-12")
"""Parameters polled; with the status, four values a second."""
POINTS = 24
_WAITING = 20_000
_STAY, _DEAF = 10, 2
_HEAD = """\
format = 1
[server]
name = "endurance"
history = { file = "history.sqlite", megabytes = 200 }
audit = "audit.jsonl"
[[door]]
kind = "http"
listen = "127.0.0.1:0"
[[alarm]]
name = "tripped"
on = "fault"
[[alarm]]
name = "fast"
quantity = "16-13"
above = 49.9
hysteresis = 1
"""


def plant_text(lines: int, drives: int) -> str:
    """Return the text of the plant file."""
    parts = [_HEAD]
    parameters = ", ".join(f'"{each}"' for each in POLLED)
    for line in range(lines):
        parts.append(f'[[line]]\nname = "{line}"\nport = "/dev/null"\nbaudrate = 57600')
        parts += [
            f'[[drive]]\nname = "d{line}-{number}"\ndrive = "danfoss-fc:{number}"\nline = "{line}"\narmed = true\n'
            f'options = {{ model = "fc302" }}\npoll = [{{ parameters = [{parameters}] }}]\n'
            'link_loss = { policy = "ramp", watchdog_s = 5 }\n'
            for number in range(1, drives + 1)
        ]
    return "\n".join(parts)


class Endurance:
    """One run. asked: the options of the command line."""

    def __init__(self, folder: Path, asked: argparse.Namespace) -> None:
        self.file = folder / "plant.toml"
        self.text = plant_text(asked.lines, asked.drives)
        self.file.write_text(self.text, encoding="utf-8")
        self.asked = asked
        self.began_s = time.time() - 3600 * asked.hours
        self.names = [drive.name for drive in read_plant(self.file).drives]
        self.at_s = self.began_s
        self.stay: list[socket.socket] = []
        self.over = Event()
        self.virtual = VirtualPlant(read_plant(self.file))
        self.serving = Serving(self.file, port_of=self.port_of)
        self.done = {"streams": 0, "orders": 0, "refused": 0, "kept": 0, "reloads": 0, "scraped": 0, "histories": 0}

    def port_of(self, line: Any) -> Callable[[], Any]:
        """Return a function that opens the port of a line."""
        return self.virtual.line(line.name).port if self.asked.polled else _no_port

    async def run(self) -> None:
        """Serve for the given time."""
        if self.asked.polled:
            for line in self.virtual.lines.values():
                line.pass_time(self.began_s)
        ready = asyncio.get_running_loop().create_future()
        serving = asyncio.create_task(self.serving.run(ready.set_result))
        await asyncio.wait({serving, ready}, return_when=asyncio.FIRST_COMPLETED)
        if serving.done():
            await serving
        core = ready.result()._core  # noqa: SLF001 - replaces the polling of fifty lines
        threads = [Thread(target=self.guarded, args=(each,), daemon=True) for each in (self.read, self.command)]
        for thread in threads:
            thread.start()
        before = None
        for point in range(1, POINTS + 1):
            until_s = self.began_s + point * 3600 * self.asked.hours / POINTS
            await (self.polled(until_s) if self.asked.polled else self.fed(core, until_s))
            self.tell(core, until_s)
            if self.asked.trace and point == POINTS // 4:
                tracemalloc.start()
                before = tracemalloc.take_snapshot()
        if before is not None:
            self.tell_growth(before)
        self.over.set()
        for thread in threads:
            await asyncio.to_thread(thread.join)
        print(json.dumps({"done": self.done}), flush=True)
        self.serving.end()
        await serving

    async def polled(self, until_s: float) -> None:
        """Wait until the time of the slowest line reaches `until_s`; trip and switch off a drive now and then."""
        lines = self.virtual.lines.values()
        while min(line.time for line in lines) < until_s:
            await asyncio.sleep(0.05)
            name = random.choice(self.names)
            if random.random() < 0.1:
                self.virtual.trip(name, 14)
            elif random.random() < 0.1:
                self.virtual.power_off(name)
            else:
                self.virtual.power_on(name)

    async def fed(self, core: Any, until_s: float) -> None:
        """Put the plant's values into the table, second by second, as fast as the history writes them."""
        table, journal = core.table, core.journal
        while self.at_s < until_s:
            self.at_s += 1.0
            for place, name in enumerate(self.names):
                at_s = self.at_s + place / len(self.names)
                for parameter in (*POLLED, STATUS):
                    table.put_value(_value(name, parameter, at_s))
                if random.random() < 1e-4:
                    table.record_event("silent", f"does not answer since {at_s:.0f}", drive=name)
                if place % 50 == 0:
                    await asyncio.sleep(0.003)
            # Some values come from elsewhere: the server itself marks values of unpolled lines as bad now and then.
            while journal.waiting > _WAITING:  # noqa: ASYNC110 - the count belongs to a thread
                await asyncio.sleep(0.02)

    def tell(self, core: Any, until_s: float) -> None:
        """Print the present state of the server as JSON."""
        gc.collect()
        folder = self.file.parent
        size = {path.name: path.stat().st_size for path in folder.glob("history.sqlite*")}
        told = {
            "hours": round((until_s - self.began_s) / 3600, 3),
            "rss_mib": round(_resident_mib(), 1),
            "objects": len(gc.get_objects()),
            "values": core.journal.written,
            "missing": core.journal.missing,
            "history_mb": round(size.get("history.sqlite", 0) / 1e6, 1),
            "wal_mb": round(size.get("history.sqlite-wal", 0) / 1e6, 1),
            "processor_s": round(time.process_time(), 1),
        }
        print(json.dumps(told), flush=True)

    def tell_growth(self, before: tracemalloc.Snapshot) -> None:
        """Print the allocations since this snapshot that are still alive."""
        gc.collect()
        ours = tracemalloc.Filter(inclusive=False, filename_pattern=tracemalloc.__file__)
        after = tracemalloc.take_snapshot().filter_traces([ours])
        for each in after.compare_to(before.filter_traces([ours]), "lineno")[:25]:
            print(each, file=sys.stderr)

    def guarded(self, work: Callable[[LocalServer, int], None]) -> None:
        """Repeat a client's work until the end of the run."""
        found = server_of_plant(self.file)
        if found is None:
            raise SystemExit("the server is not there")
        server = LocalServer(found)
        turn = 0
        while not self.over.is_set():
            turn += 1
            try:
                work(server, turn)
            except DriveCommError:
                self.done["refused"] += 1
            time.sleep(0.02)
        server.close()

    def read(self, server: LocalServer, turn: int) -> None:
        """Do the work of reading clients: short-lived streams, ten permanent streams, a scraper, and a history request.

        Two of the permanent streams are never read.
        """
        port = int(self.serving.doors[0].rpartition(":")[2])
        while len(self.stay) < _STAY:
            self.stay.append(_stream(port))
        for place, connected in enumerate(self.stay[_DEAF:], _DEAF):
            if not _drained(connected):
                self.stay[place] = _stream(port)
        with _stream(port) as gone:
            gone.settimeout(1)
            with suppress(TimeoutError):
                gone.recv(1000)
        self.done["streams"] += 1
        if turn % 20 == 0:
            with socket.create_connection(("127.0.0.1", port)) as scraper:
                scraper.sendall(b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
                while scraper.recv(1 << 20):
                    pass
            self.done["scraped"] += 1
            now = time.time()
            server.ask(f"/api/v1/history/events?from={now - 9e4:.0f}&to={now + 9e4:.0f}&limit=50")
            server.ask("/api/v1/events")
            self.done["histories"] += 1

    def command(self, server: LocalServer, turn: int) -> None:
        """Do the work of commanding clients: leases that are released or left to expire, and reloads."""
        name = self.names[turn % len(self.names)]
        key = server.order(f"/api/v1/drives/{name}/lease", {"seconds": 0.5})["key"]
        verb = ("reset", "keep", "start", "stop")[turn % 4]
        # The server stores results by id for ten minutes of real time, so only few orders have an id.
        content = {
            "id": f"{turn}" if turn % 20 == 0 else "",
            "lease": key,
            **({"arguments": {"policy": "ramp"}} if verb == "keep" else {}),
        }
        answer = server.order(f"/api/v1/drives/{name}/{verb}", content)
        self.done["orders"] += 1
        self.done["kept"] += verb == "keep" and answer["outcome"] == "done"
        if turn % 3:
            server.order(f"/api/v1/drives/{name}/lease", {"key": key}, method="DELETE")
        if turn % 100 == 0:
            more = f'\n[[drive]]\nname = "new {turn}"\ndrive = "danfoss-fc:90"\nline = "0"\n'
            self.file.write_text(self.text + more, encoding="utf-8")
            os.kill(os.getpid(), 1)
            self.done["reloads"] += 1


def _no_port() -> Any:
    raise PortError("this line is not asked; its values are put in")


def _value(drive: str, parameter: str, at_s: float) -> CurrentValue:
    if random.random() < 0.002:
        cause = f"no reply within {random.randint(100, 120)} ms"
        return CurrentValue(drive=drive, name=parameter, reading=None, quality="bad", cause=cause, time_s=at_s)
    raw = random.randint(0, 500)
    reading = Reading(parameter=parameter, value=Decimal(raw) / 10, raw=raw, time_s=at_s, unit="Hz")
    return CurrentValue(drive=drive, name=parameter, reading=reading, quality="good", time_s=at_s)


def _stream(port: int) -> socket.socket:
    connected = socket.create_connection(("127.0.0.1", port))
    connected.sendall(b"GET /api/v1/stream HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    return connected


def _drained(connected: socket.socket) -> bool:
    """Read all available data; return whether the connection is still open."""
    connected.setblocking(False)
    try:
        while connected.recv(1 << 20):
            pass
    except BlockingIOError:
        return True
    except OSError:
        pass
    connected.close()
    return False


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Run as the command line says."""
    parser = argparse.ArgumentParser(description="Does a server grow in six hours?")
    parser.add_argument("--hours", type=float, default=6.0)
    parser.add_argument("--lines", type=int, default=50)
    parser.add_argument("--drives", type=int, default=10)
    parser.add_argument("--polled", action="store_true")
    parser.add_argument("--trace", action="store_true")
    random.seed(1)
    with TemporaryDirectory(prefix="dc") as folder:
        os.environ.update(STATE_DIRECTORY=folder, XDG_RUNTIME_DIR=folder)
        asyncio.run(Endurance(Path(folder), parser.parse_args()).run())


if __name__ == "__main__":
    main()
