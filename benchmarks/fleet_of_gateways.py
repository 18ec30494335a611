"""Many gateways on one broker, and a fleet view of all of them.

    python benchmarks/fleet_of_gateways.py --gateways 20 --drives 500

The MQTT doors, the broker (mosquitto) and the fleet are real. The plants behind the doors are played, because one
machine cannot poll the lines of 10,000 drives. Each drive's status and two values change once per period.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import shutil
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.line import STATUS
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig, Reading
from drivecomm.server import CurrentValue, DriveSnapshot
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.server.fleet import Fleet, FleetSubscription
from drivecomm.server.mqtt import mqtt_door, name_of
from drivecomm.tomlfile import TomlTable

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Collection, Iterator, Mapping, Sequence

_QUANTITIES = ("output_frequency", "output_current")
_UNITS = {"output_frequency": "Hz", "output_current": "A"}


class PlayedPlant:
    """A plant as a door sees it, whose drives only report that they run."""

    users = history = None
    session = "played"

    def __init__(self, name: str, drives: int) -> None:
        self.name = name
        self._values: dict[tuple[str, str], CurrentValue] = {}
        self._changes: list[_Changes] = []
        played = tuple(
            DriveConfig(protocol="vabus", address=1, name=f"drive {number}", line=f"line {number}")
            for number in range(drives)
        )
        lines = tuple(PlantLine(name=each.line) for each in played)
        self.plant = Plant(lines=lines, drives=played, file=f"/nowhere/{name}.toml")
        self._drives = [DriveSnapshot(config=each, line=each.line, reachability="answers") for each in played]

    def drives(self) -> Sequence[DriveSnapshot]:
        """Return all drives."""
        return self._drives

    def answering(self) -> Collection[str]:
        """Return the names of all drives."""
        return {each.name for each in self.plant.drives}

    def alarms(self) -> Sequence[Any]:
        """Return no alarms."""
        return []

    def standing_stops(self) -> Mapping[str, Any]:
        """Return no standing stops."""
        return {}

    def drifts(self) -> Mapping[str, Any]:
        """Return no drifts."""
        return {}

    def values(self) -> Sequence[CurrentValue]:
        """Return all current values."""
        return list(self._values.values())

    def events(self) -> Sequence[Any]:
        """Return no events."""
        return []

    def changes(self, _every_s: float = 0.0) -> _Changes:
        """Return the changes from now on."""
        self._changes.append(_Changes())
        return self._changes[-1]

    def may(self, _caller: Any, _drive: str) -> Sequence[str]:
        """Grant no permissions."""
        return []

    def tell(self, text: str, **_: Any) -> None:
        """Print a message of a door."""
        sys.stderr.write(f"{self.name}: {text}\n")

    async def play(self, period_s: float) -> None:
        """Change the values of each drive once per period."""
        while True:
            for drive in self._drives:
                now = time.time()
                self._put(drive.name, STATUS, "running", now)
                for name in _QUANTITIES:
                    self._put(drive.name, name, Decimal(random.randrange(5000)) / 100, now)
                await asyncio.sleep(period_s / len(self._drives))

    def _put(self, drive: str, name: str, value: Any, now: float) -> None:
        reading = Reading(parameter=name, name=name, value=value, unit=_UNITS.get(name, ""), raw=0, time_s=now)
        value = CurrentValue(drive=drive, name=name, reading=reading, quality="good", time_s=now)
        self._values[drive, name] = value
        for each in self._changes:
            each.add(value)


class _Changes:
    """Batches of changed values."""

    lost = 0

    def __init__(self) -> None:
        self._new: list[CurrentValue] = []
        self._come = asyncio.Event()

    def add(self, value: CurrentValue) -> None:
        """Add a value to the next batch."""
        self._new.append(value)
        self._come.set()

    async def __aiter__(self) -> AsyncIterator[tuple[Sequence[CurrentValue], Sequence[Any]]]:
        """Yield batches as they come."""
        while True:
            await self._come.wait()
            self._come.clear()
            new, self._new = self._new, []
            yield new, []

    def close(self) -> None:
        """Unsubscribe from the changes."""
        self._new.clear()


@contextmanager
def _broker(folder: Path) -> Iterator[tuple[str, int]]:
    """Run mosquitto on a free port; yield its URL and its process id."""
    program = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        raise UsageError("mosquitto is not installed; install it to measure with it")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    file = folder / "mosquitto.conf"
    file.write_text(f"listener {port} 127.0.0.1\nuser root\nallow_anonymous true\nmax_queued_messages 0\n")
    with subprocess.Popen([program, "-c", str(file)], stderr=subprocess.DEVNULL) as process:
        try:
            _wait_for(port)
            yield f"mqtt://127.0.0.1:{port}", process.pid
        finally:
            process.kill()


def _wait_for(port: int) -> None:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise UsageError("mosquitto does not begin")


def _usage(pid: int) -> tuple[float, float]:
    """Return the processor time of a process in seconds, and its memory in MiB."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    memory = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), memory


async def _measure(url: str, pid: int, given: argparse.Namespace) -> None:
    plants = [PlayedPlant(f"plant {number}", given.drives) for number in range(given.gateways)]
    table = TomlTable({"broker": url, "messages": "drives"}, "here")
    doors = [mqtt_door(table) for _ in plants]
    running = [asyncio.create_task(plant.play(given.period)) for plant in plants]
    began = time.monotonic()
    for door, plant in zip(doors, plants, strict=True):
        running.append(asyncio.create_task(door.run(plant, lambda: None)))  # type: ignore[arg-type]
    settings = broker_settings(TomlTable({"broker": url}, "here"), TomlTable({"broker": url}, "here").take(BROKER_KEYS))
    watched = Fleet()
    heard = _Counting(watched)
    running.append(asyncio.create_task(FleetSubscription(settings, heard).run()))  # type: ignore[arg-type]
    all_drives = given.gateways * given.drives
    while sum(each.summary.running for each in watched.plants.values()) < all_drives:
        if time.monotonic() - began > 20 * given.period + 60:
            raise UsageError("not all drives were seen")
        await asyncio.sleep(0.1)
    print(f"all {all_drives} drives of {given.gateways} plants seen {time.monotonic() - began:.1f} s after the start")
    own, broker, messages, at = time.process_time(), _usage(pid)[0], heard.messages, time.monotonic()
    heard.ages.clear()
    await asyncio.sleep(given.seconds)
    seconds = time.monotonic() - at
    ages = sorted(heard.ages)
    print(
        f"{(heard.messages - messages) / seconds:.0f} messages/s; of a core: gateways and fleet "
        f"{(time.process_time() - own) / seconds:.2f}, broker {(_usage(pid)[0] - broker) / seconds:.2f}; broker "
        f"{_usage(pid)[1]:.0f} MiB; age of a status at the fleet p50 {1000 * ages[len(ages) // 2]:.0f} ms, p99 "
        f"{1000 * ages[int(0.99 * len(ages))]:.0f} ms"
    )
    fresh, began = Fleet(), time.monotonic()
    await FleetSubscription(settings, fresh).known()
    known = sum(len(each.shown) for each in fresh.plants.values())
    print(f"a new fleet view knows {known} drives {time.monotonic() - began:.1f} s after it connects")
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)


class _Counting:
    """A fleet that counts the messages it receives."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet, self.messages = fleet, 0
        self.ages: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fleet, name)

    def take(self, topic: str, payload: bytes) -> None:
        """Process and count a message."""
        self.messages += 1
        self._fleet.take(topic, payload)
        if topic.endswith("/values"):
            _, plant, drive, _ = map(name_of, topic.split("/"))
            self.ages.append(time.time() - self._fleet.plants[plant].drives[drive].values[STATUS].time_s)


def main() -> None:
    """Run the measurement and print its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gateways", type=int, default=20)
    parser.add_argument("--drives", type=int, default=500, help="of each gateway")
    parser.add_argument("--period", type=float, default=20.0, help="seconds between two values of a drive")
    parser.add_argument("--seconds", type=float, default=30.0, help="how long is measured")
    given = parser.parse_args()
    with TemporaryDirectory(prefix="dc") as folder:
        os.environ["STATE_DIRECTORY"] = folder
        with _broker(Path(folder)) as (url, pid):
            asyncio.run(_measure(url, pid, given))


if __name__ == "__main__":
    main()
