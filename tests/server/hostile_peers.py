"""Hostile peers of a door: each is a separate program that takes a port and runs until it is killed.

A row of `PEERS` gives the kind of door, the attack and the program. A new door adds its rows to `PEERS` and its
`[[door]]` to `DOORS`.
"""

DOORS = {
    "http": '[[door]]\nkind = "http"\nlisten = "127.0.0.1:{port}"\n',
    "modbus-tcp": '[[door]]\nkind = "modbus-tcp"\nlisten = "127.0.0.1:{port}"\nunits = {{ fan = 3, pump = 4 }}\n',
    "opcua": '[[door]]\nkind = "opcua"\nlisten = "127.0.0.1:{port}"\n',
    "mqtt": '[[door]]\nkind = "mqtt"\nbroker = "mqtt://127.0.0.1:{port}"\n',
    "sparkplug": (
        '[[door]]\nkind = "sparkplug"\nbroker = "mqtt://127.0.0.1:{port}"\ngroup = "works"\nnode = "hall"\n'
        'role = "operate"\n'
    ),
}
"""Entry in the plant file for each kind of door."""

_FLOOD = """
import select, socket, sys, time
open_ = []
while True:
    while len(open_) < {connections}:
        one = socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5)
        one.setblocking(False)
        open_.append(one)
    readable, writable, _ = select.select(open_, open_, [], 1)
    for one in readable:
        try:
            if one.recv(1 << 16):
                continue
        except OSError:
            pass
        open_.remove(one)
        one.close()
    for one in writable:
        if one in open_:
            try:
                one.send({request!r} * {times})
            except OSError:
                pass
"""

_CONNECTS = """
import socket, sys
while True:
    try:
        socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5).close()
    except OSError:
        pass
"""

_STALL = """
import socket, sys, time
while True:
    there = []
    for _ in range({connections}):
        try:
            one = socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5)
            one.sendall({begin!r})
            there.append(one)
        except OSError:
            pass
    time.sleep(1)
    for one in there:
        one.close()
"""

_GARBAGE = """
import os, socket, sys
while True:
    try:
        with socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5) as one:
            while True:
                one.sendall(os.urandom(4096))
    except OSError:
        pass
"""

_NEVER_READS = """
import socket, sys, time
there = []
while True:
    while len(there) < {connections}:
        one = socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5)
        one.setblocking(False)
        there.append(one)
    for one in list(there):
        try:
            one.send({request!r} * {times})
        except BlockingIOError:
            pass
        except OSError:
            there.remove(one)
            one.close()
    time.sleep(0.01)
"""

_ASKS_FOR_ENDPOINTS = """
import asyncio, sys
from asyncua import Client

async def ask():
    while True:
        client = Client(f"opc.tcp://127.0.0.1:{sys.argv[1]}", timeout=5)
        try:
            await client.connect_socket()
            await client.send_hello()
            await client.open_secure_channel()
            while True:
                await client.get_endpoints()
        except Exception:
            await asyncio.sleep(0.1)
        finally:
            client.disconnect_socket()

async def main():
    await asyncio.gather(*(ask() for _ in range(5)))

asyncio.run(main())
"""

_LISTENS = """
import os, socket, sys, threading, time

def serve(one):
    {does}

with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as listening:
    while True:
        one = listening.accept()[0]
        threading.Thread(target=serve, args=(one,), daemon=True).start()
"""

_SENDS_GARBAGE = """
    try:
        while True:
            one.sendall(os.urandom(4096))
    except OSError:
        pass
"""

_FLOODS_SUBSCRIBERS = """
    data, topic = b"", b""
    try:
        while True:
            if topic and not data:
                payload = os.urandom(200)
                packet = len(topic).to_bytes(2, "big") + topic + bytes(1) + payload
                length = bytes([len(packet) & 0x7F | 0x80, len(packet) >> 7])
                try:
                    one.settimeout(5)
                    one.sendall((b"\\x30" + length + packet) * 50)
                    one.settimeout(0.001)
                    data = one.recv(4096)
                    if not data:
                        return
                except TimeoutError:
                    pass
                continue
            if len(data) < 2:
                data += one.recv(4096) or exit()
                continue
            size, place, shift = 0, 1, 0
            while True:
                size |= (data[place] & 0x7F) << shift
                shift, place = shift + 7, place + 1
                if not data[place - 1] & 0x80:
                    break
            while len(data) < place + size:
                data += one.recv(4096) or exit()
            kind, body, data = data[0], data[place : place + size], data[place + size :]
            if kind >> 4 == 1:
                one.sendall(bytes([0x20, 3, 0, 0, 0]))
            elif kind >> 4 == 3 and kind & 6:
                name = int.from_bytes(body[:2], "big")
                one.sendall(bytes([0x40, 2]) + body[2 + name : 4 + name])
            elif kind >> 4 == 8:
                # After the number and the length of the properties, of which there are none.
                name = int.from_bytes(body[3:5], "big")
                topic = body[5 : 5 + name].replace(b"+", b"fan").replace(b"#", b"fan")
                one.sendall(bytes([0x90, 4]) + body[:2] + bytes([0, 1]))
            elif kind >> 4 == 12:
                one.sendall(bytes([0xD0, 0]))
    except OSError:
        pass
"""

BROKERS = frozenset({"mqtt", "sparkplug"})
"""Kinds of doors that connect to their peer."""

BYSTANDER = """
import selectors, socket
listening = socket.create_server(("127.0.0.1", 0), backlog=1024)
listening.setblocking(False)
print(listening.getsockname()[1], flush=True)
ready = selectors.DefaultSelector()
ready.register(listening, selectors.EVENT_READ)
while True:
    for key, _ in ready.select():
        one = key.fileobj
        try:
            if one is listening:
                accepted = one.accept()[0]
                accepted.setblocking(False)
                ready.register(accepted, selectors.EVENT_READ)
                continue
            if one.recv(1024):
                one.send(bytes(249))
                continue
        except BlockingIOError:
            continue
        except OSError:
            pass
        ready.unregister(one)
        one.close()
"""
"""Program that accepts connections in place of a door.

A run against it shows the load that the peer itself puts on the machine.
"""

_GET = b"GET /api/v1/values HTTP/1.1\r\nHost: localhost\r\n\r\n"
_STREAM = b"GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n"
_READ = b"\0\1\0\0\0\6\3\4\0\0\0\x78"

PEERS = [
    ("http", "floods", _FLOOD.format(connections=20, request=_GET, times=1)),
    ("http", "connects", _CONNECTS),
    ("http", "stalls", _STALL.format(connections=100, begin=_GET[:20])),
    ("http", "sends garbage", _GARBAGE),
    ("http", "never reads", _NEVER_READS.format(connections=20, request=_STREAM, times=1)),
    ("modbus-tcp", "floods", _FLOOD.format(connections=20, request=_READ, times=50)),
    ("modbus-tcp", "connects", _CONNECTS),
    ("modbus-tcp", "stalls", _STALL.format(connections=100, begin=_READ[:5])),
    ("modbus-tcp", "sends garbage", _GARBAGE),
    ("modbus-tcp", "never reads", _NEVER_READS.format(connections=20, request=_READ, times=50)),
    ("opcua", "floods", _ASKS_FOR_ENDPOINTS),
    ("opcua", "connects", _CONNECTS),
    ("opcua", "stalls", _STALL.format(connections=100, begin=b"HELF")),
    ("opcua", "sends garbage", _GARBAGE),
    ("mqtt", "floods", _LISTENS.format(does=_FLOODS_SUBSCRIBERS)),
    ("mqtt", "stalls", _LISTENS.format(does="time.sleep(1000)")),
    ("mqtt", "sends garbage", _LISTENS.format(does=_SENDS_GARBAGE)),
    ("mqtt", "hangs up", _LISTENS.format(does="one.close()")),
    ("sparkplug", "floods", _LISTENS.format(does=_FLOODS_SUBSCRIBERS)),
    ("sparkplug", "sends garbage", _LISTENS.format(does=_SENDS_GARBAGE)),
]
"""Kind of door, name of the attack, and its program."""
