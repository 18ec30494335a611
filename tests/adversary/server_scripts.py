"""Random scripts over a server: what is ordered at all its doors, and what happens to it, its files and its lines."""

import asyncio
import os
import resource
import signal
import time
from contextlib import suppress

from door_clients import Http, OnBroker, Plc
from opcua_client import OpcuaUser
from orders import Book, Trouble
from server_bench import DRIVES
from server_judge import AFTER_STOP_S, LEVEL_S

from drivecomm.server import ended

_PAUSES = (0.0, 0.05, 0.3, 0.3, 1.0, 1.0, 2.5, 6.0)
_UNTROUBLED_S, _LAST_S = 9.0, 30.0
_SECONDS = (0.5, 2.0, 5.0, 12.0)
_LINES = ("hall", "yard")
_HOWS = ("ramp", "ramp", "coast", "quick")


def random_steps(chance, kinds):
    """Return 5 to 25 steps: how long to wait, what is done, and how."""
    able = [each for each in STEPS if DOOR_OF.get(each, "http") in kinds]
    weights = [WEIGHTS.get(each, 2) for each in able]
    favourite = chance.choice(list(DRIVES))
    steps = []
    for _ in range(chance.randrange(5, 26)):
        what = chance.choices(able, weights)[0]
        drive = favourite if chance.random() < 0.6 else chance.choice(list(DRIVES))
        steps.append([chance.choice(_PAUSES), what, {name: make(chance, drive) for name, make in STEPS[what].items()}])
    return steps


def _drive(_, drive):
    return drive


def _line_of(_, drive):
    return DRIVES[drive][0]


def _of(*values):
    return lambda chance, _: chance.choice(values)


_KEPT = {"drive": _drive, "lease_s": _of(1.0, 2.0, 4.0), "there_s": _of(0.0, 3.0, 8.0, 20.0)}
STEPS = {
    "http_start": _KEPT,
    "http_start_twice": _KEPT,
    "http_start_loosely": {
        "drive": _drive,
        "lease_s": _of(0, 2.0),
        "policy": _of("hold"),
        "watchdog_s": _of(None, 600),
    },
    "http_start_watchdog": {**_KEPT, "watchdog_s": _of(0.5, 600)},
    "http_start_alone": {"drive": _drive},
    "http_stop": {"drive": _drive, "how": _of(*_HOWS), "leaves": _of(False, False, True)},
    "http_stop_all": {},
    "http_reference": {"drive": _drive, "percent": _of(20, 80)},
    "http_flood": {"drive": _drive, "count": _of(10, 40)},
    "local_start": {"drive": _drive},
    "local_stop": {"drive": _drive},
    "local_stop_all": {},
    "mqtt_start": _KEPT,
    "mqtt_start_loosely": {
        "drive": _drive,
        "lease_s": _of(0, 2.0),
        "policy": _of("hold"),
        "watchdog_s": _of(None, 600),
    },
    "mqtt_start_kept": {"drive": _drive},
    "mqtt_replay": {},
    "mqtt_stop": {"drive": _drive, "how": _of(*_HOWS)},
    "mqtt_stop_all": {},
    "sparkplug_online": {"ahead_s": _of(0.0, 0.0, 3600.0)},
    "sparkplug_offline": {},
    "sparkplug_start": {"drive": _drive},
    "sparkplug_stop": {"drive": _drive},
    "modbus_start": {"drive": _drive},
    "modbus_stop": {"drive": _drive, "standing": _of(True, True, False)},
    "modbus_leave": {"drive": _drive},
    "opcua_start": {"drive": _drive, "there_s": _of(1.0, 6.0)},
    "opcua_stop": {"drive": _drive},
    "line_away": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "requests_lost": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "replies_lost": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "noise": {
        "line": _line_of,
        "seconds": _of(*_SECONDS),
        "rate": _of(0.2, 0.5),
        "kind": _of("corrupt", "drop", "truncate", "duplicate"),
    },
    "power_cut": {"drive": _drive, "seconds": _of(*_SECONDS)},
    "trip": {"drive": _drive},
    "broker_cut": {},
    "broker_away": {"seconds": _of(*_SECONDS)},
    "wall_clock": {"seconds": _of(-3600, -3.0, 1.5, 30.0, 86400)},
    "disk_full": {"seconds": _of(*_SECONDS)},
    "descriptors_gone": {"seconds": _of(*_SECONDS)},
    "reload": {"change": _of("title", "poll", "half", "away", "none")},
    "remove": {"drive": _drive, "seconds": _of(*_SECONDS)},
    "server_ends": {"pause": _of(0.0, 3.0)},
    "server_killed": {"pause": _of(0.0, 3.0)},
}
DOOR_OF = {
    each: "modbus-tcp" if each.startswith("modbus") else each.partition("_")[0]
    for each in STEPS
    if each.partition("_")[0] in {"mqtt", "sparkplug", "modbus", "opcua"}
}
DOOR_OF |= {"broker_cut": "mqtt", "broker_away": "mqtt"}
WEIGHTS = {
    "http_start": 6,
    "mqtt_start": 4,
    "http_stop": 5,
    "mqtt_stop": 3,
    "local_start": 3,
    "modbus_start": 4,
    "modbus_stop": 4,
}
WEIGHTS |= {"sparkplug_online": 4, "sparkplug_start": 4, "opcua_start": 5, "opcua_stop": 3, "requests_lost": 3}
WEIGHTS |= {
    "server_ends": 0.4,
    "server_killed": 0.7,
    "reload": 1,
    "remove": 1,
    "disk_full": 1,
    "descriptors_gone": 0.5,
    "wall_clock": 1,
}


class Script:
    """Carries out the steps. bench: with its server open."""

    def __init__(self, bench):
        self.bench, self.book = bench, Book()
        self.otto, self.here = Http(bench, self.book, "otto"), Http(bench, self.book)
        self.vera = Http(bench, self.book, "vera")
        self.broker, self.opcua = OnBroker(bench, self.book), None
        self.plcs = {drive: Plc(bench, self.book, drive) for drive in DRIVES}
        self._under_way, self._changing = set(), asyncio.Lock()

    async def open(self):
        if "mqtt" in self.bench.kinds or "sparkplug" in self.bench.kinds:
            await self.broker.open()
        if "opcua" in self.bench.kinds:
            self.opcua = OpcuaUser(self.bench, self.book)

    async def play(self, steps):
        for pause, what, how in steps:
            await asyncio.sleep(pause)
            task = asyncio.create_task(getattr(self, what)(**how), name=what)
            self._under_way.add(task)
            task.add_done_callback(self._under_way.discard)
            # It is asked for before the next step is.
            await asyncio.sleep(0)

    async def settle(self, seconds):
        """Let everybody go who is still there, mend everything, and wait until nothing is owed any more."""
        if self._under_way:
            await asyncio.wait(self._under_way, timeout=_LAST_S)
        # What stands still stands for a while.
        await asyncio.sleep(AFTER_STOP_S + LEVEL_S + 1.0)
        for plc in self.plcs.values():
            plc.stop(standing=False)
            await plc.disconnect()
        if "sparkplug" in self.bench.kinds:
            await self.broker.host(online=False)
        for task in list(self._under_way):
            await ended(task)
        last = max([time.monotonic(), *(each.until for each in self.book.troubles)])
        if not (self.book.troubles or self.book.deaths or self.book.removals):
            seconds = _UNTROUBLED_S
        await asyncio.sleep(last - time.monotonic() + seconds / 2)
        await self.note_values()
        await asyncio.sleep(seconds / 2)

    async def close(self):
        if self.broker._task is not None:
            await self.broker.close()
        if self.opcua is not None:
            await self.opcua.close()

    async def note_values(self):
        drives = await self.vera.ask("GET", "values")
        for each in drives if isinstance(drives, list) else ():
            if each["quality"] == "good" and each["name"] == "output_frequency" and each["reading"]:
                at = time.monotonic()
                self.book.said.append((at, each["drive"], float(each["reading"]["value"]), each["age_s"] or 0.0))

    # Commanders

    async def http_start(self, **how):
        await self.otto.start(**how)

    async def http_start_twice(self, **how):
        await self.otto.start(**how, repeats=True)

    async def http_start_watchdog(self, **how):
        await self.otto.start(**how)

    async def http_start_loosely(self, drive, lease_s, policy, watchdog_s):
        said = {"policy": policy} if watchdog_s is None else {"watchdog_s": watchdog_s}
        await self.otto.start(drive, lease_s=lease_s, there_s=1.0, **said)

    async def http_start_alone(self, drive):
        await self.otto.start(drive, lease_s=0)

    async def http_stop(self, **how):
        await self.vera.stop(**how)

    async def http_stop_all(self):
        await self.vera.stop()

    async def http_reference(self, drive, percent):
        await self.otto.do(drive, "set_reference", percent=percent)

    async def http_flood(self, drive, count):
        await asyncio.gather(*(self.vera.do(drive, "read", parameter="output_frequency") for _ in range(count)))

    async def local_start(self, drive):
        await self.here.start_here(drive)

    async def local_stop(self, drive):
        await self.here.stop(drive)

    async def local_stop_all(self):
        await self.here.stop()

    async def mqtt_start(self, **how):
        await self.broker.start(**how)

    async def mqtt_start_loosely(self, drive, lease_s, policy, watchdog_s):
        said = {"policy": policy} if watchdog_s is None else {"watchdog_s": watchdog_s}
        await self.broker.start(drive, lease_s=lease_s, there_s=1.0, **said)

    async def mqtt_start_kept(self, drive):
        await self.broker.start(drive, lease_s=0, retain=True)

    async def mqtt_replay(self):
        await self.broker.replay()

    async def mqtt_stop(self, **how):
        await self.broker.stop(**how)

    async def mqtt_stop_all(self):
        await self.broker.stop()

    async def sparkplug_online(self, ahead_s):
        await self.broker.host(online=True, ahead_s=ahead_s)

    async def sparkplug_offline(self):
        await self.broker.host(online=False)

    async def sparkplug_start(self, drive):
        await self.broker.host_starts(drive)

    async def sparkplug_stop(self, drive):
        await self.broker.host_stops(drive)

    async def modbus_start(self, drive):
        self.plcs[drive].start()

    async def modbus_stop(self, drive, standing):
        self.plcs[drive].stop(standing)

    async def modbus_leave(self, drive):
        await self.plcs[drive].disconnect()

    async def opcua_start(self, drive, there_s):
        await self.opcua.start(drive, there_s)

    async def opcua_stop(self, drive):
        await self.opcua.stop(drive)

    # Lines and drives

    def _trouble(self, seconds, kind, **what):
        now = time.monotonic()
        self.book.troubles.append(Trouble(now, now + seconds, kind, **what))

    async def line_away(self, line, seconds):
        self._trouble(seconds, "away", line=line, dead=True)
        self.bench.plant.lines[line].away = True
        self.bench.plant.lines[line].cut()
        await asyncio.sleep(seconds)
        self.bench.plant.lines[line].away = False

    async def requests_lost(self, line, seconds):
        self._trouble(seconds, "requests lost", line=line, dead=True)
        self.bench.plant.add_fault(seconds, line=line, kind="drop", of="request")

    async def replies_lost(self, line, seconds):
        self._trouble(seconds, "replies lost", line=line)
        self.bench.plant.add_fault(seconds, line=line, kind="drop", of="reply")

    async def noise(self, line, seconds, rate, kind):
        self._trouble(seconds, "noise", line=line)
        self.bench.plant.add_fault(seconds, line=line, kind=kind, rate=rate, seed=7)

    async def power_cut(self, drive, seconds):
        self._trouble(seconds, "no power", drive=drive)
        self.bench.plant.virtual.power_off(drive)
        await asyncio.sleep(seconds)
        self.bench.plant.virtual.power_on(drive)

    async def trip(self, drive):
        self.bench.plant.virtual.trip(drive, 5 if DRIVES[drive][1].startswith("fuji") else 4)

    # The server, its files, its machine

    async def broker_cut(self):
        self.bench.broker.cut_all()

    async def broker_away(self, seconds):
        self.bench.broker.deaf = True
        self.bench.broker.cut_all()
        await asyncio.sleep(seconds)
        self.bench.broker.deaf = False

    async def wall_clock(self, seconds):
        self.bench.clocks.step_wall(seconds)

    async def disk_full(self, seconds):
        await self._limited(resource.RLIMIT_FSIZE, 0, seconds)

    async def descriptors_gone(self, seconds):
        await self._limited(resource.RLIMIT_NOFILE, 3, seconds)

    async def _limited(self, which, to, seconds):
        before = resource.getrlimit(which)
        if before[0] == to:
            return
        resource.setrlimit(which, (to, before[1]))
        try:
            await asyncio.sleep(seconds)
        finally:
            resource.setrlimit(which, before)

    async def reload(self, change):
        async with self._changing:
            file = self.bench.file
            whole = file.read_text()
            try:
                if change == "title":
                    file.write_text(whole.replace('name = "fan"', 'name = "fan"\ntitle = "other"', 1))
                elif change == "poll":
                    file.write_text(whole.replace("], period_s = 1", "], period_s = 0.7"))
                elif change == "half":
                    file.write_text(whole[: len(whole) // 2] + "][")
                elif change == "away":
                    file.unlink()
                os.kill(os.getpid(), signal.SIGHUP)
                if change in ("title", "poll"):
                    changed = ("fan",) if change == "title" else tuple(DRIVES)
                    self.book.removals += [(time.monotonic(), each) for each in changed]
                await asyncio.sleep(1.0)
            finally:
                with suppress(OSError):
                    file.write_text(whole)

    async def remove(self, drive, seconds):
        async with self._changing:
            self.book.removals.append((time.monotonic(), drive))
            self.bench.write_plant(without=(drive,))
            os.kill(os.getpid(), signal.SIGHUP)
            await asyncio.sleep(seconds)
            self.bench.write_plant()
            os.kill(os.getpid(), signal.SIGHUP)
            await asyncio.sleep(1.0)

    async def server_ends(self, pause):
        async with self._changing:
            died = time.monotonic()
            self.book.deaths.append([died, "told to end", died])
            await self.bench.end()
            await asyncio.sleep(pause)
            await self.bench.serve()

    async def server_killed(self, pause):
        async with self._changing:
            died = time.monotonic()
            self.book.deaths.append([died, "killed", died])
            await self.bench.kill()
            await asyncio.sleep(pause)
            await self.bench.serve()
