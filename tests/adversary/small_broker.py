"""MQTT broker in the event loop of its clients, so that messages take no real time.

It supports the parts of MQTT 5 that the doors and their peers use: QoS 0 and 1, retained messages, wills, and takeover
of a client id.
"""

import asyncio
import struct
from contextlib import suppress

CONNECT, CONNACK, PUBLISH, PUBACK, SUBSCRIBE, SUBACK, UNSUBSCRIBE, UNSUBACK = 1, 2, 3, 4, 8, 9, 10, 11
PINGREQ, PINGRESP, DISCONNECT = 12, 13, 14
_TAKEN_OVER, _WITH_WILL = 0x8E, 0x04


class SmallBroker:
    """An MQTT broker. deaf: accept all data without answering or forwarding anything."""

    def __init__(self):
        self.kept, self.clients, self.port, self.deaf = {}, {}, 0, False
        self._server = None

    @property
    def url(self):
        return f"mqtt://127.0.0.1:{self.port}"

    async def start(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def end(self):
        """Stop the broker; retained messages survive until it is restarted."""
        self._server.close()
        self.cut_all()
        await asyncio.sleep(0)

    def cut_all(self):
        for each in list(self.clients.values()):
            each.writer.transport.abort()

    def publish(self, topic, payload, *, retain=False):
        if retain:
            self.kept.pop(topic, None)
            if payload:
                self.kept[topic] = payload
        for each in list(self.clients.values()):
            each.offer(topic, payload, retain)

    async def _serve(self, reader, writer):
        client = None
        try:
            while True:
                kind, flags, body = await _packet(reader)
                if self.deaf:
                    continue
                if kind == CONNECT:
                    client = _Client(self, writer, body)
                    if (other := self.clients.get(client.name)) is not None:
                        other.send(DISCONNECT, 0, bytes([_TAKEN_OVER, 0]))
                        other.writer.close()
                    self.clients[client.name] = client
                    client.send(CONNACK, 0, bytes([0, 0, 0]))
                elif client is not None and not client.took(kind, flags, body):
                    return
        except (EOFError, ConnectionError, asyncio.CancelledError):
            pass
        finally:
            writer.close()
            if client is not None:
                if self.clients.get(client.name) is client:
                    del self.clients[client.name]
                if client.will is not None:
                    self.publish(*client.will[:2], retain=client.will[2])


class _Client:
    def __init__(self, broker, writer, body):
        self._broker, self.writer, self._filters, self._number = broker, writer, {}, 0
        read = _Reader(body)
        read.bytes_of(read.two())
        read.one()
        flags = read.one()
        read.two()
        read.properties()
        self.name = read.text()
        self.will = None
        if flags & 0x04:
            read.properties()
            self.will = read.text(), read.bytes_of(read.two()), bool(flags & 0x20)

    def took(self, kind, flags, body):
        """Process a packet; return whether the connection stays open."""
        read = _Reader(body)
        if kind == PUBLISH:
            topic, qos = read.text(), flags >> 1 & 3
            number = read.two() if qos else 0
            read.properties()
            if qos:
                self.send(PUBACK, 0, struct.pack(">H", number))
            self._broker.publish(topic, read.rest(), retain=bool(flags & 1))
        elif kind == SUBSCRIBE:
            number, _ = read.two(), read.properties()
            new = []
            while read.left():
                new.append((read.text(), read.one()))
            self._filters.update(new)
            self.send(SUBACK, 0, struct.pack(">HB", number, 0) + bytes(options & 1 for _, options in new))
            wanted = dict(each for each in new if each[1] >> 4 & 3 != 2)
            for topic, payload in list(self._broker.kept.items()):
                if any(_fits(each, topic) for each in wanted):
                    self._deliver(topic, payload, retained=True)
        elif kind == UNSUBSCRIBE:
            number, _ = read.two(), read.properties()
            gone = []
            while read.left():
                gone.append(self._filters.pop(read.text(), None))
            self.send(UNSUBACK, 0, struct.pack(">HB", number, 0) + bytes(len(gone)))
        elif kind == PINGREQ:
            self.send(PINGRESP, 0, b"")
        elif kind == DISCONNECT:
            if not body or body[0] != _WITH_WILL:
                self.will = None
            return False
        return True

    def offer(self, topic, payload, retain):
        if any(_fits(each, topic) for each in self._filters):
            # All subscribers here use "retain as published".
            self._deliver(topic, payload, retained=retain)

    def _deliver(self, topic, payload, *, retained):
        self._number = self._number % 65535 + 1
        name = topic.encode()
        self.send(
            PUBLISH, 2 | retained, struct.pack(">H", len(name)) + name + struct.pack(">HB", self._number, 0) + payload
        )

    def send(self, kind, flags, body):
        length, head = len(body), bytearray([kind << 4 | flags])
        while True:
            length, digit = divmod(length, 128)
            head.append(digit | (0x80 if length else 0))
            if not length:
                break
        with suppress(RuntimeError, ConnectionError):
            self.writer.write(bytes(head) + body)


class _Reader:
    def __init__(self, body):
        self._body, self._at = body, 0

    def bytes_of(self, count):
        self._at += count
        return self._body[self._at - count : self._at]

    def one(self):
        return self.bytes_of(1)[0]

    def two(self):
        return struct.unpack(">H", self.bytes_of(2))[0]

    def text(self):
        return self.bytes_of(self.two()).decode()

    def properties(self):
        length = shift = 0
        while True:
            digit = self.one()
            length, shift = length | (digit & 0x7F) << shift, shift + 7
            if not digit & 0x80:
                return self.bytes_of(length)

    def left(self):
        return self._at < len(self._body)

    def rest(self):
        return self._body[self._at :]


async def _packet(reader):
    first = (await reader.readexactly(1))[0]
    length = shift = 0
    while True:
        digit = (await reader.readexactly(1))[0]
        length, shift = length | (digit & 0x7F) << shift, shift + 7
        if not digit & 0x80:
            break
    return first >> 4, first & 0x0F, await reader.readexactly(length)


def _fits(wanted, topic):
    wanted, parts = wanted.split("/"), topic.split("/")
    for place, each in enumerate(wanted):
        if each == "#":
            return True
        if place >= len(parts) or each not in ("+", parts[place]):
            return False
    return len(wanted) == len(parts)
