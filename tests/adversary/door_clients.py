"""Commanders of a server, one at each door. Each of their orders is written into the book, with what came of it."""

import asyncio
import json
import struct
import time
from contextlib import suppress
from itertools import count

from orders import FOREVER, Start, Stop
from server_bench import TOKENS, UNITS

from drivecomm.server import ended
from drivecomm.server.broker import BROKER_KEYS, Message, broker_settings
from drivecomm.server.broker.connection import connected
from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encoded
from drivecomm.server.sparkplug.wire import payload_class
from drivecomm.tomlfile import Table

PATIENCE_S = 20.0
_HEARD = ("drivecomm/plant/bridge/state", "drivecomm/plant/+/response", "drivecomm/plant/bridge/response/#")
_HEARD += ("spBv1.0/plant/NBIRTH/#",)
_STOP, _AGAIN_S = 1000, 0.2


class Http:
    """Requests of one user, each on a connection of its own; without a user, by the local socket."""

    def __init__(self, bench, book, user=""):
        self._bench, self._book, self._user, self._numbers = bench, book, user, count(1)
        self.door = "http" if user else "local"

    async def ask(self, method, path, content=None, *, leaves=False):
        """Return the answer; None where none came. leaves: does not wait for it."""
        body = b"" if content is None else json.dumps(content).encode()
        head = f"{method} /api/v1/{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        if self._user:
            head += f"Authorization: Bearer {TOKENS[self._user]}\r\n"
        try:
            async with asyncio.timeout(PATIENCE_S):
                if self._user:
                    reader, writer = await asyncio.open_connection("127.0.0.1", self._bench.doors["http"].port)
                else:
                    reader, writer = await asyncio.open_unix_connection(self._bench.serving.socket)
                try:
                    writer.write(head.encode() + b"\r\n" + body)
                    if leaves:
                        await writer.drain()
                        return None
                    told = await reader.read()
                finally:
                    writer.close()
            return json.loads(told.partition(b"\r\n\r\n")[2])
        except (OSError, ValueError, TimeoutError):
            return None

    def _id(self):
        return f"{self.door} {self._user} {next(self._numbers)}"

    async def start(self, drive, *, lease_s=2.0, there_s=3.0, repeats=False, **arguments):
        """Start a motor under a lease and renew it for a while; without one where lease_s is 0."""
        order = Start(time.monotonic(), self.door, drive, present_until=0.0)
        self._book.starts.append(order)
        content = {"id": self._id(), "arguments": {"percent": 60, **arguments}}
        key = ""
        if lease_s:
            taken = await self.ask("POST", f"drives/{drive}/lease", {"seconds": lease_s})
            key = (taken or {}).get("key", "")
            if not key:
                order.outcome, order.answered = "refused", time.monotonic()
                return
            content["lease"] = key
            order.present_until = time.monotonic() + lease_s
        await self._ordered(order, drive, "start", content)
        if repeats:
            await asyncio.sleep(there_s)
            # The same order once more: it was answered, so that it starts nothing.
            await self.ask("POST", f"drives/{drive}/start", content)
        if not lease_s or self._is_hold(drive):
            order.present_until = FOREVER if self._is_hold(drive) else 0.0
            return
        until = time.monotonic() + there_s
        while time.monotonic() < until and order.outcome != "refused":
            await asyncio.sleep(lease_s / 3)
            asked = time.monotonic()
            renewed = await self.ask("PUT", f"drives/{drive}/lease", {"key": key, "seconds": lease_s})
            if "until_s" in (renewed or {}):
                order.present_until = asked + lease_s + (time.monotonic() - asked)
            elif renewed is not None:
                return

    async def start_here(self, drive):
        """Start a motor as a program of the server's machine does that lets it run on without anybody."""
        order = Start(time.monotonic(), self.door, drive, local=True)
        self._book.starts.append(order)
        await self._ordered(order, drive, "keep", {"id": self._id(), "policy": "hold", "percent": 60})

    async def _ordered(self, order, drive, verb, content):
        answer = await self.ask("POST", f"drives/{drive}/{verb}", content)
        _answered(order, answer)

    async def stop(self, drive="", *, how="ramp", leaves=False):
        order = Stop(time.monotonic(), self.door, drive, how=how)
        self._book.stops.append(order)
        if drive:
            content = {"id": self._id(), "arguments": {"how": how}}
            answer = await self.ask("POST", f"drives/{drive}/stop", content, leaves=leaves)
            _answered(order, answer)
        else:
            answer = await self.ask("POST", "stop", {"how": how}, leaves=leaves)
            if isinstance(answer, list):
                order.answered, order.outcome = time.monotonic(), "open"

    async def do(self, drive, verb, **arguments):
        return await self.ask("POST", f"drives/{drive}/{verb}", {"id": self._id(), "arguments": arguments})

    def _is_hold(self, drive):
        return self._bench.policies[drive] == "hold"


def _answered(order, answer):
    if isinstance(answer, dict) and "outcome" in answer:
        order.answered, order.outcome = time.monotonic(), answer["outcome"]
    elif isinstance(answer, dict):
        order.answered, order.outcome = time.monotonic(), "refused"


class OnBroker:
    """Somebody on the broker: a panel that commands by MQTT, and a primary host of Sparkplug."""

    def __init__(self, bench, book):
        self._bench, self._book, self._numbers = bench, book, count(1)
        self._answers, self.session, self._births = {}, "", ""
        self._connection, self._task, self._last = None, None, None

    async def open(self):
        table = Table({"broker": self._bench.broker.url}, "x.toml")
        settings = broker_settings(table, table.take(BROKER_KEYS))
        there = asyncio.Event()

        async def stay():
            while True:
                with suppress(Exception):
                    async with connected(settings, "panel", self._hear) as self._connection:
                        await self._connection.subscribe_with_kept(*_HEARD)
                        there.set()
                        await self._connection.lost()
                await asyncio.sleep(0.5)

        self._task = asyncio.create_task(stay())
        await there.wait()

    async def close(self):
        await ended(self._task)

    def _hear(self, received):
        parts = received.topic.split("/")
        if parts[0] == "spBv1.0":
            if parts[2] == "NBIRTH":
                metrics = payload_class().FromString(received.payload).metrics
                self._births = next((each.string_value for each in metrics if each.name == "Properties/Session"), "")
            return
        with suppress(ValueError):
            content = json.loads(received.payload)
            if received.topic.endswith("bridge/state"):
                self.session = content.get("session", "")
            elif "/response" in received.topic and isinstance(content, dict):
                waiting = self._answers.pop(content.get("id"), None)
                if waiting is not None and not waiting.done():
                    waiting.set_result(content)

    async def _publish(self, topic, payload, *, retain=False):
        payload = json.dumps(payload) if isinstance(payload, dict) else payload
        with suppress(Exception):
            async with asyncio.timeout(PATIENCE_S):
                await self._connection.publish(Message(topic=topic, payload=payload, retain=retain))
                return True
        return False

    async def _ask(self, topic, content):
        content = {"id": f"m{next(self._numbers)}", "token": TOKENS["otto"], "session": self.session, **content}
        answer = self._answers[content["id"]] = asyncio.get_running_loop().create_future()
        await self._publish(topic, content)
        with suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE_S):
                return await answer
        return None

    # MQTT

    async def start(self, drive, *, lease_s=2.0, there_s=3.0, retain=False, **arguments):
        order = Start(time.monotonic(), "mqtt", drive, present_until=0.0)
        self._book.starts.append(order)
        content = {"verb": "start", "issued_s": time.time(), "valid_s": 5, "arguments": {"percent": 50, **arguments}}
        key = ""
        if lease_s:
            taken = await self._ask("drivecomm/plant/bridge/request/lease/take", {"drive": drive, "seconds": lease_s})
            key = ((taken or {}).get("result") or {}).get("key", "")
            if not key:
                order.outcome, order.answered = "refused", time.monotonic()
                return
            content["lease"], order.present_until = key, time.monotonic() + lease_s
        if retain:
            order.outcome, order.answered = "refused", order.at
            await self._publish(f"drivecomm/plant/{drive}/command", self._whole(content), retain=True)
            return
        self._last = drive, content
        content["issued_s"] = time.time()
        _answered(order, await self._ask(f"drivecomm/plant/{drive}/command", content))
        if self._bench.policies[drive] == "hold":
            order.present_until = FOREVER
            return
        until = time.monotonic() + there_s
        while lease_s and time.monotonic() < until and order.outcome != "refused":
            await asyncio.sleep(lease_s / 3)
            content = {"drive": drive, "key": key, "seconds": lease_s}
            renewed = await self._ask("drivecomm/plant/bridge/request/lease/renew", content)
            if (renewed or {}).get("outcome") == "done":
                order.present_until = time.monotonic() + lease_s
            elif renewed is not None:
                return

    def _whole(self, content):
        return {"id": f"m{next(self._numbers)}", "token": TOKENS["otto"], "session": self.session, **content}

    async def replay(self):
        """Publish the last start once more as it was, as a broker or a logger might."""
        if self._last is not None:
            await self._publish(f"drivecomm/plant/{self._last[0]}/command", self._whole(self._last[1]))

    async def stop(self, drive="", how="ramp"):
        order = Stop(time.monotonic(), "mqtt", drive, how=how)
        self._book.stops.append(order)
        if drive:
            _answered(
                order, await self._ask(f"drivecomm/plant/{drive}/command", {"verb": "stop", "arguments": {"how": how}})
            )
        else:
            answer = await self._ask("drivecomm/plant/bridge/request/stop", {"how": how})
            if answer is not None:
                order.answered, order.outcome = time.monotonic(), "open"

    # Sparkplug

    async def host(self, *, online, ahead_s=0.0):
        said = {"online": online, "timestamp": round((time.time() + ahead_s) * 1000)}
        await self._publish("spBv1.0/STATE/scada", said, retain=True)
        if not online:
            for each in self._book.starts:
                if each.door == "sparkplug" and each.present_until == FOREVER:
                    each.present_until = time.monotonic() if self._bench.policies[each.drive] != "hold" else FOREVER

    async def host_starts(self, drive):
        order = Start(time.monotonic(), "sparkplug", drive)
        self._book.starts.append(order)
        more = Metric(name="Command/Session", type=DataType.STRING, value=self._births)
        await self._dcmd(drive, "Command/Start", more)

    async def host_stops(self, drive):
        order = Stop(time.monotonic(), "sparkplug", drive)
        self._book.stops.append(order)
        if await self._dcmd(drive, "Command/Stop"):
            order.answered = time.monotonic()

    async def _dcmd(self, drive, name, *more):
        metric = Metric(name=name, type=DataType.BOOLEAN, value=True)
        payload = Payload(metrics=(metric, *more), time_ms=round(time.time() * 1000), uuid=f"u{next(self._numbers)}")
        return await self._publish(f"spBv1.0/plant/DCMD/gateway/{drive}", encoded(payload, say_types=True))


class Plc:
    """A PLC that writes its image of one drive in each cycle while it is connected."""

    def __init__(self, bench, book, drive):
        self._bench, self._book, self._drive = bench, book, drive
        self.stopping = self._heartbeat = self._sequence = self._command = 0
        self._task = self._reader = self._writer = self._standing = None
        self._start, self._number = None, 0

    def connect(self):
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._cycles())

    async def disconnect(self):
        if self._task is not None:
            await ended(self._task)
        self._gone()

    def _gone(self):
        now = time.monotonic()
        if self._start is not None and self._bench.policies[self._drive] != "hold":
            self._start.present_until = min(self._start.present_until, now)
        if self._standing is not None:
            self._standing.stands_until = min(self._standing.stands_until, now)
        self._start = self._standing = None

    def start(self):
        self._sequence, self._command = self._sequence + 1, 1
        self._start = Start(time.monotonic(), "modbus-tcp", self._drive)
        self._book.starts.append(self._start)
        self.connect()

    def stop(self, standing):
        """Set the stop of the image, or take it away."""
        self.stopping = int(standing)
        if not standing and self._standing is not None:
            self._standing.stands_until = time.monotonic()
            self._standing = None
        if standing:
            self.connect()

    async def _cycles(self):
        self._standing, writer = None, None
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", self._bench.doors["modbus-tcp"].port)
            while True:
                if self._command:
                    # Who only stops takes no lease.
                    self._heartbeat = self._heartbeat % 65535 + 1
                wrote = self.stopping
                words = (wrote, self._heartbeat, self._sequence, self._command, 1, 0, 0x4248, 0)
                self._number = (self._number + 1) % 65536
                pdu = struct.pack(">BHHB8H", 16, _STOP, 8, 16, *words)
                writer.write(struct.pack(">HHHB", self._number, 0, len(pdu) + 1, UNITS[self._drive]) + pdu)
                head = await asyncio.wait_for(reader.readexactly(7), PATIENCE_S)
                answer = await reader.readexactly(struct.unpack(">H", head[4:6])[0] - 1)
                if not answer[0] & 0x80 and wrote and self._standing is None:
                    self._standing = Stop(
                        time.monotonic(), "modbus-tcp", self._drive, time.monotonic(), "open", FOREVER
                    )
                    self._book.stops.append(self._standing)
                await asyncio.sleep(_AGAIN_S)
        except (OSError, EOFError, TimeoutError):
            pass
        finally:
            self._gone()
            if writer is not None:
                writer.close()
