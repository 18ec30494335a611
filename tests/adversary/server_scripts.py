"""Runner of scripts over a server: orders at all doors, and disturbances of the server, its files and its lines."""

import asyncio
import os
import resource
import signal
import time

from broker_clients import OnBroker
from http_client import Http
from opcua_client import OpcuaUser
from orders import FOREVER, Book, Removal, Trouble
from plc_client import Plc
from server_bench import DRIVES
from server_judge import AFTER_SILENCE_S, AFTER_STOP_S, LEVEL_S, QUIET, Judge

from drivecomm.server import cancel_and_wait

_LAST_S, _ATTEMPTS = 30.0, 5


class Script:
    """Runner of the steps of a script. bench: with its server running."""

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
            # Let the order start before the next step.
            await asyncio.sleep(0)

    async def settle(self):
        """Let all clients leave, end all disturbances, and wait until no stop is pending."""
        self.bench.over = True
        if self._under_way:
            await asyncio.wait(self._under_way, timeout=_LAST_S)
        if any(plc.stopping for plc in self.plcs.values()):
            # Hold the standing stops a little longer.
            await asyncio.sleep(AFTER_STOP_S + LEVEL_S + 1.0)
        for plc in self.plcs.values():
            plc.stop(standing=False)
            await plc.disconnect()
        if "sparkplug" in self.bench.kinds:
            for _ in range(_ATTEMPTS):
                if await self.broker.host(online=False):
                    break
                await asyncio.sleep(2.0)
        for task in list(self._under_way):
            await cancel_and_wait(task)
        last = max([time.monotonic(), *(each.until for each in self.book.troubles)])
        await asyncio.sleep(last - time.monotonic())
        until, quiet = last + AFTER_SILENCE_S + 6.0, 0
        while quiet < QUIET and time.monotonic() < until:
            await asyncio.sleep(1.0)
            heard = await self.note_values()
            quiet = quiet + 1 if heard and not self.judge().owes() else 0

    def judge(self):
        return Judge(self.book, self.bench.plant.truth, time.monotonic())

    async def close(self):
        if self.broker._task is not None:
            await self.broker.close()
        if self.opcua is not None:
            await self.opcua.close()

    async def note_values(self):
        """Record the published values of the drives; return whether all drives have a good one."""
        drives = await self.vera.ask("GET", "values")
        heard, at = set(), time.monotonic()
        for each in drives if isinstance(drives, list) else ():
            if each["quality"] == "good" and each["name"] == "output_frequency" and each["reading"]:
                heard.add(each["drive"])
                self.book.said.append((at, each["drive"], float(each["reading"]["value"]), each["age_s"] or 0.0))
        return heard == set(DRIVES)

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
        self.book.broker_lost.append(time.monotonic())
        self.bench.broker.cut_all()

    async def broker_away(self, seconds):
        self.book.broker_lost.append(time.monotonic())
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
                    self.bench.write(whole.replace('name = "fan"', 'name = "fan"\ntitle = "other"', 1))
                elif change == "poll":
                    self.bench.write(whole.replace("], period_s = 1", "], period_s = 0.7"))
                elif change == "half":
                    self.bench.write(whole[: len(whole) // 2] + "][")
                elif change == "away":
                    file.unlink()
                os.kill(os.getpid(), signal.SIGHUP)
                if change in ("title", "poll"):
                    changed = ("fan",) if change == "title" else tuple(DRIVES)
                    now = time.monotonic()
                    self.book.removals += [Removal(now, each, now) for each in changed]
                await asyncio.sleep(1.0)
            finally:
                self.bench.write(whole)

    async def remove(self, drive, seconds):
        async with self._changing:
            gone = Removal(time.monotonic(), drive)
            self.book.removals.append(gone)
            self.bench.write_plant(without=(drive,))
            os.kill(os.getpid(), signal.SIGHUP)
            await asyncio.sleep(seconds)
            self.bench.write_plant()
            os.kill(os.getpid(), signal.SIGHUP)
            gone.back = time.monotonic()
            await asyncio.sleep(1.0)

    async def server_ends(self, pause):
        async with self._changing:
            death = [time.monotonic(), "told to end", FOREVER]
            self.book.deaths.append(death)
            await self.bench.end()
            await asyncio.sleep(pause)
            await self.bench.serve_again()
            death[2] = time.monotonic()

    async def server_killed(self, pause):
        async with self._changing:
            death = [time.monotonic(), "killed", FOREVER]
            self.book.deaths.append(death)
            await self.bench.kill()
            await asyncio.sleep(pause)
            await self.bench.serve_again()
            death[2] = time.monotonic()
