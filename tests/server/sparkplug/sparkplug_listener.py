"""Observers of an edge node: a host on the broker, and a wire between the edge node and the broker."""

import asyncio
import time
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import count
from types import SimpleNamespace

import aiomqtt
from paho.mqtt.subscribeoptions import SubscribeOptions
from sparkplug_plant import GROUP, HOST, NODE, state

from drivecomm.server import cancel_and_wait
from drivecomm.server.sparkplug.wire import payload_class

NODE_KINDS, DEVICE_KINDS = ("NBIRTH", "NDEATH", "NDATA"), ("DBIRTH", "DDEATH", "DDATA")


@dataclass(frozen=True, slots=True)
class Heard:
    """A message as a host receives it. message: decoded by protobuf; None if it cannot be decoded."""

    topic: str
    data: bytes
    qos: int
    retain: bool
    at: float

    @property
    def parts(self):
        return self.topic.split("/")

    @property
    def kind(self):
        return self.parts[2] if len(self.parts) > 3 else ""

    @property
    def device(self):
        return self.parts[4] if len(self.parts) > 4 else ""

    @property
    def message(self):
        return payload_class().FromString(self.data)

    def metric(self, name):
        return next((each for each in self.message.metrics if each.name == name), None)


class Listener:
    """A host that records all messages, and resolves metrics by the aliases of the births."""

    def __init__(self, client):
        self.client, self.heard = client, []

    def of(self, *kinds, device=None):
        return [each for each in self.heard if each.kind in kinds and device in (None, each.device)]

    def names(self):
        """Return device, name and type of each alias, as the births define them."""
        return {
            metric.alias: (each.device, metric.name, metric.datatype)
            for each in self.of("NBIRTH", "DBIRTH")
            for metric in each.message.metrics
            if metric.HasField("alias")
        }

    def values(self, device, name, *, historical=None):
        """Return all values of a metric with their times, from births and data, in order of arrival."""
        names, found = self.names(), []
        for each in self.of("NBIRTH", "NDATA", "DBIRTH", "DDATA"):
            for metric in each.message.metrics:
                known = metric.name or names[metric.alias][1]
                if (each.device, known) == (device, name) and historical in (None, metric.is_historical):
                    which = metric.WhichOneof("value")
                    found.append((metric.timestamp, None if which is None else getattr(metric, which)))
        return found

    def value(self, device, name):
        found = self.values(device, name, historical=False)
        return found[-1][1] if found else None

    async def until(self, condition, seconds=15.0):
        async with asyncio.timeout(seconds):
            while not (found := condition()):  # noqa: ASYNC110 - any condition
                await asyncio.sleep(0.01)
            return found

    async def command(self, device, payload, **options):
        kind, end = ("DCMD", f"/{device}") if device else ("NCMD", "")
        await self.client.publish(f"spBv1.0/{GROUP}/{kind}/{NODE}{end}", payload, **options)

    async def host(self, **said):
        await self.client.publish(f"spBv1.0/STATE/{HOST}", state(**said), qos=1, retain=True)


@asynccontextmanager
async def listening(port):
    """Yield a host that subscribes to everything on a broker; losing the connection later raises no error."""
    options = SubscribeOptions(qos=1, retainAsPublished=True)
    async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.subscribe("spBv1.0/#", options=options)
        listener = Listener(client)
        task = asyncio.create_task(_hear(client, listener))
        try:
            yield listener
        finally:
            await cancel_and_wait(task)


async def _hear(client, listener):
    with suppress(aiomqtt.MqttError):
        async for each in client.messages:
            listener.heard.append(Heard(str(each.topic), each.payload, each.qos, each.retain, time.monotonic()))


class Wire:
    """Proxy between an edge node and its broker that records the packets sent by the edge node."""

    def __init__(self, port):
        self._to, self.packets, self.port = port, [], 0
        self._writers = set()
        self._numbers = count()

    async def __aenter__(self):
        await self._listen()
        self.port = self._server.sockets[0].getsockname()[1]
        self.url = f"mqtt://127.0.0.1:{self.port}"
        return self

    async def __aexit__(self, *_):
        self._server.close()
        self.cut()

    async def _listen(self):
        self._server = await asyncio.start_server(self._connected, "127.0.0.1", self.port)

    @asynccontextmanager
    async def away(self):
        """Refuse new connections during the block, and cut all open ones."""
        self._server.close()
        self.cut()
        yield
        await self._listen()

    def cut(self):
        """Cut all connections, as a network failure does."""
        for each in self._writers:
            each.transport.abort()

    def of(self, kind):
        return [each for each in self.packets if each.kind == kind]

    async def _connected(self, reader, writer):
        try:
            there, back = await asyncio.open_connection("127.0.0.1", self._to)
        except OSError:
            writer.transport.abort()
            return
        self._writers |= {writer, back}
        with suppress(OSError):
            await asyncio.gather(self._pass(reader, back, self._keeper()), self._pass(there, writer, lambda _: None))
        self._writers -= {writer, back}

    async def _pass(self, reader, writer, keep):
        try:
            while data := await reader.read(65536):
                keep(data)
                writer.write(data)
                await writer.drain()
        finally:
            # Bytes already sent still arrive before the other side is closed.
            writer.close()

    def _keeper(self):
        waiting, version, number = bytearray(), 5, next(self._numbers)

        def keep(data):
            nonlocal version
            waiting.extend(data)
            while (found := _packet(waiting, version)) is not None:
                version = getattr(found, "version", version)
                found.connection = number
                self.packets.append(found)

        return keep


_KINDS = {1: "CONNECT", 3: "PUBLISH", 8: "SUBSCRIBE", 14: "DISCONNECT"}


def _packet(waiting, version):
    """Remove a whole MQTT packet from the waiting bytes and return it; None if it is incomplete."""
    length, shift, at = 0, 0, 1
    while True:
        if at >= len(waiting):
            return None
        length |= (waiting[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if not waiting[at - 1] & 0x80:
            break
    if len(waiting) < at + length:
        return None
    raw, body = bytes(waiting[: at + length]), bytes(waiting[at : at + length])
    del waiting[: at + length]
    found = SimpleNamespace(kind=_KINDS.get(raw[0] >> 4, ""), flags=raw[0] & 0xF, raw=raw, body=body)
    if found.kind == "CONNECT":
        _read_connect(found)
    elif found.kind == "PUBLISH":
        found.topic, end = _text(body, 0)
        end += 2 if found.flags & 6 else 0
        # An edge node sends no properties.
        found.payload = body[end + 1 :] if version == 5 else body[end:]
    elif found.kind == "SUBSCRIBE":
        found.filters, end = {}, 2
        end += 1 + body[2] if version == 5 else 0
        while end < len(body):
            name, end = _text(body, end)
            found.filters[name] = body[end] & 3
            end += 1
    elif found.kind == "DISCONNECT":
        found.reason = body[0] if body else 0
    return found


def _read_connect(found):
    body = found.body
    _, at = _text(body, 0)
    found.version, flags = body[at], body[at + 1]
    at += 4
    found.clean, found.has_will, found.will_qos, found.will_retain = (
        bool(flags & 2), bool(flags & 4), flags >> 3 & 3, bool(flags & 32),
    )  # fmt: skip
    found.expiry_s = 0
    if found.version == 5:
        properties = body[at + 1 : at + 1 + body[at]]
        if properties[:1] == b"\x11":
            found.expiry_s = int.from_bytes(properties[1:5])
        at += 1 + body[at]
    found.client, at = _text(body, at)
    if found.has_will:
        if found.version == 5:
            at += 1 + body[at]
        found.will_topic, at = _text(body, at)
        size = int.from_bytes(body[at : at + 2])
        found.will = payload_class().FromString(body[at + 2 : at + 2 + size])


def _text(body, at):
    size = int.from_bytes(body[at : at + 2])
    return body[at + 2 : at + 2 + size].decode(), at + 2 + size
