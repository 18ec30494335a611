"""Commanders on a broker, by MQTT and by Sparkplug; their orders and the outcomes are recorded in the book."""

import asyncio
import json
import time
from contextlib import suppress
from itertools import count

from orders import FOREVER, Start, Stop, note_answer
from server_bench import PATIENCE_S, TOKENS

from drivecomm.server import cancel_and_wait
from drivecomm.server.broker import BROKER_KEYS, BrokerMessage, broker_settings
from drivecomm.server.broker.connection import connect_to_broker
from drivecomm.server.sparkplug.payload import DataType, Metric, Payload, encode_payload
from drivecomm.server.sparkplug.wire import payload_class
from drivecomm.tomlfile import TomlTable

_WITHOUT_BROKER_S = 10.0
_HEARD = ("drivecomm/plant/bridge/state", "drivecomm/plant/+/response", "drivecomm/plant/bridge/response/#")
_HEARD += ("spBv1.0/plant/NBIRTH/#",)


class OnBroker:
    """Client of the broker: a panel that commands by MQTT, and a primary host of Sparkplug."""

    def __init__(self, bench, book):
        self._bench, self._book, self._numbers = bench, book, count(1)
        self._answers, self.session, self._births = {}, "", ""
        self._connection, self._task, self._last = None, None, None

    async def open(self):
        table = TomlTable({"broker": self._bench.broker.url}, "x.toml")
        settings = broker_settings(table, table.take(BROKER_KEYS))
        there = asyncio.Event()

        async def stay():
            while True:
                with suppress(Exception):
                    async with connect_to_broker(settings, "panel", self._hear) as self._connection:
                        await self._connection.subscribe_with_kept(*_HEARD)
                        there.set()
                        await self._connection.lost()
                await asyncio.sleep(0.5)

        self._task = asyncio.create_task(stay())
        await there.wait()

    async def close(self):
        await cancel_and_wait(self._task)

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
                await self._connection.publish(BrokerMessage(topic=topic, payload=payload, retain=retain))
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
        note_answer(order, await self._ask(f"drivecomm/plant/{drive}/command", content))
        if self._bench.policies[drive] == "hold":
            order.present_until = FOREVER
            return
        until = time.monotonic() + there_s
        while lease_s and time.monotonic() < until and not self._bench.over and order.outcome != "refused":
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
        """Publish the last start again unchanged, as a broker or a logger might."""
        if self._last is not None:
            await self._publish(f"drivecomm/plant/{self._last[0]}/command", self._whole(self._last[1]))

    async def stop(self, drive="", how="ramp"):
        order = Stop(time.monotonic(), "mqtt", drive, how=how)
        self._book.stops.append(order)
        if drive:
            note_answer(
                order, await self._ask(f"drivecomm/plant/{drive}/command", {"verb": "stop", "arguments": {"how": how}})
            )
        else:
            answer = await self._ask("drivecomm/plant/bridge/request/stop", {"how": how})
            if answer is not None:
                order.answered, order.outcome = time.monotonic(), "open"

    async def stop_by_its_topic(self, drive):
        """Stop a drive by its stop topic, which the door serves independently of the command topic."""
        order = Stop(time.monotonic(), "mqtt", drive)
        self._book.stops.append(order)
        note_answer(order, await self._ask(f"drivecomm/plant/{drive}/stop", {"how": "ramp"}))

    # Sparkplug

    async def host(self, *, online, ahead_s=0.0):
        said = {"online": online, "timestamp": round((time.time() + ahead_s) * 1000)}
        published = await self._publish("spBv1.0/STATE/scada", said, retain=True)
        if published and not online:
            # A door whose broker is lost notices it later, and drops the demand by itself after a while.
            now = time.monotonic()
            gone = max([now, *(at + _WITHOUT_BROKER_S for at in self._book.broker_lost if at <= now)])
            for each in self._book.starts:
                if each.door == "sparkplug" and each.present_until == FOREVER:
                    each.present_until = gone if self._bench.policies[each.drive] != "hold" else FOREVER
        return published

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
        return await self._publish(f"spBv1.0/plant/DCMD/gateway/{drive}", encode_payload(payload, say_types=True))
