"""Cost of all doors together: 500 drives, four values of each a second, and a client at each door.

    python benchmarks/all_doors.py --seconds 30

`drivecomm serve` polls the drives that `drivecomm simulate` serves on the same machine. The clients are an MQTT and a
Sparkplug subscriber, an OPC UA client that subscribes to every value, a Modbus TCP master that reads every drive once a
second, and a reader of the HTTP API's stream. The same plant is first served once without doors.
"""

from __future__ import annotations

import argparse
import asyncio
import http.client
import json
import logging
import os
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import paho.mqtt.client as mqtt
from asyncua import Client, ua
from fleet_of_gateways import _broker
from paho.mqtt.enums import CallbackAPIVersion
from plant_of_50_lines import usage
from served_plant import BAUDRATE, DRIVES, LINES, VALUES, _lines, plant_text

import drivecomm

_DOORS = """
[[door]]
kind = "mqtt"
broker = "{broker}"
prefix = "bench/hall"
messages = "{messages}"
[[door]]
kind = "sparkplug"
broker = "{broker}"
group = "bench"
node = "hall"
[[door]]
kind = "opcua"
listen = "127.0.0.1:0"
[[door]]
kind = "modbus-tcp"
listen = "127.0.0.1:0"
units = {{ {units} }}
"""
_MOST_UNITS = 247
_NAMESPACE = 2
_RAMP_S = 400
_SUBSCRIBED_WITHIN_S = 120


def _turning(place: str) -> None:
    """Start the motors of a line with a ramp so slow that every poll reads a new value."""
    with drivecomm.open_bus(place, baudrate=BAUDRATE) as bus:
        for address in range(1, DRIVES + 1):
            drive = bus.drive("danfoss-fc", address=address, model="fc302")
            drive.write("3-41", _RAMP_S)
            drive.set_reference(percent=100)
            drive.start()


def _served(path: Path, folder: Path) -> tuple[subprocess.Popen[str], dict[str, Any]]:
    for each in ("state", "run"):
        (folder / each).mkdir(mode=0o700, exist_ok=True)
    environment = {**os.environ, "STATE_DIRECTORY": str(folder / "state"), "XDG_RUNTIME_DIR": str(folder / "run")}
    command = [sys.executable, "-m", "drivecomm", "serve", str(path), "--json", "--level", "error"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    told = json.loads((server.stdout.readline() if server.stdout else "") or "null")
    return server, told


def _share(server: subprocess.Popen[str], told: dict[str, Any], seconds: float) -> tuple[float, float, float]:
    """Return a server's share of a core, its memory in MiB, and its reads per second."""
    began, before, first = time.monotonic(), usage(server.pid), _lines(told["socket"])
    time.sleep(seconds)
    took, after, last = time.monotonic() - began, usage(server.pid), _lines(told["socket"])
    return (after.processor_s - before.processor_s) / took, after.memory_mib, (last[0] - first[0]) / took


class _Ages:
    """Ages of values on arrival at a client, in seconds."""

    def __init__(self) -> None:
        self.guard, self.seconds = threading.Lock(), list[float]()

    def add(self, ages: list[float]) -> None:
        with self.guard:
            self.seconds += ages

    def told(self) -> str:
        with self.guard:
            ages = sorted(self.seconds)
        if not ages:
            return "nothing came"
        p50, p99 = ages[len(ages) // 2], ages[int(0.99 * len(ages))]
        return f"{len(ages)} values, age p50 {1000 * p50:.1f} ms, p99 {1000 * p99:.1f} ms"


def _subscribe(port: int, topic: str, ages: _Ages) -> mqtt.Client:
    def took(_: Any, __: Any, message: mqtt.MQTTMessage) -> None:
        now = time.time()
        if "/bridge/" in message.topic or message.topic.endswith("/availability"):
            return
        content = json.loads(message.payload)
        values = content.values() if message.topic.endswith("/values") else [content]
        ages.add([now - each["time_s"] for each in values if "repeated" not in each])

    client = mqtt.Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    if topic.startswith("bench/"):
        client.on_message = took
    else:
        client.on_message = lambda *_: ages.add([0.0])
    client.subscribe(topic)
    client.loop_start()
    return client


async def _opcua(url: str, ages: _Ages, subscribed: threading.Event, stop: threading.Event) -> None:
    async with Client(url, timeout=60) as client:

        class Handler:
            def datachange_notification(self, _node: Any, _value: Any, data: Any) -> None:
                stamp = data.monitored_item.Value.SourceTimestamp
                if stamp is not None:
                    ages.add([time.time() - stamp.timestamp()])

        subscription = await client.create_subscription(100, Handler())
        places = ["Status/State", *(f"Parameters/{each}" for each in VALUES)]
        nodes = [
            client.get_node(ua.NodeId(f"drives/d{line}-{drive}/{place}", _NAMESPACE))
            for line in range(LINES)
            for drive in range(1, DRIVES + 1)
            for place in places
        ]
        for place in range(0, len(nodes), 100):
            await subscription.subscribe_data_change(nodes[place : place + 100])
        subscribed.set()
        await asyncio.to_thread(stop.wait)


def _modbus(port: int, units: int, stop: threading.Event) -> None:
    with socket.create_connection(("127.0.0.1", port)) as master:
        while not stop.is_set():
            began = time.monotonic()
            for unit in range(1, units + 1):
                master.sendall(bytes.fromhex(f"00010000 0006 {unit:02X} 04 0000 0078"))
                head = _exactly(master, 6)
                _exactly(master, int.from_bytes(head[4:], "big"))
            stop.wait(max(0.0, 1 - (time.monotonic() - began)))


def _exactly(peer: socket.socket, count: int) -> bytes:
    found = b""
    while len(found) < count:
        found += peer.recv(count - len(found))
    return found


def _stream(place: str, stop: threading.Event) -> None:
    host, _, port = place.rpartition(":")
    connection = http.client.HTTPConnection(host, int(port))
    connection.request("GET", "/api/v1/stream")
    answer = connection.getresponse()
    while not stop.is_set() and answer.read1(65536):
        pass


def main() -> None:
    """Run the measurement and print its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--messages", choices=("quantities", "drives"), default="drives")
    parser.add_argument("--turning", action="store_true", help="motors speed up meanwhile, so that every value changes")
    given = parser.parse_args()
    # Warnings of the OPC UA client about our server are checked elsewhere.
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    with TemporaryDirectory(prefix="dc") as name, ExitStack() as stack:
        folder = Path(name)
        path = folder / "plant.toml"
        path.write_text(plant_text(LINES), encoding="utf-8")
        command = [sys.executable, "-m", "drivecomm", "simulate", str(path), "--json"]
        simulated = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(simulated.terminate)
        told = json.loads(simulated.stdout.readline() if simulated.stdout else "null")
        plant = plant_text([line["listening"] for line in told["lines"]])
        if given.turning:
            with ThreadPoolExecutor(8) as several:
                list(several.map(_turning, [line["listening"] for line in told["lines"]]))
        url, broker = stack.enter_context(_broker(folder))
        path.write_text(plant, encoding="utf-8")
        server, told = _served(path, folder)
        time.sleep(5)
        alone = _share(server, told, given.seconds)
        server.terminate()
        server.wait(20)
        print(f"without doors but http: {alone[2]:.0f} reads/s, {alone[0]:.2f} of a core, {alone[1]:.0f} MiB")
        names = [f'"d{line}-{drive}" = {line * DRIVES + drive}' for line in range(LINES) for drive in range(1, 11)]
        doors = _DOORS.format(broker=url, messages=given.messages, units=", ".join(names[:_MOST_UNITS]))
        path.write_text(plant + doors, encoding="utf-8")
        server, told = _served(path, folder)
        stack.callback(server.terminate)
        places = {door.split()[0]: door.split()[1] for door in told["doors"]}
        time.sleep(8)
        at_mqtt, at_sparkplug, at_opcua = _Ages(), _Ages(), _Ages()
        port = int(url.rpartition(":")[2])
        clients = [_subscribe(port, "bench/#", at_mqtt), _subscribe(port, "spBv1.0/#", at_sparkplug)]
        subscribed, stop = threading.Event(), threading.Event()
        opcua, modbus = f"opc.tcp://{places['opcua']}", int(places["modbus-tcp"].rpartition(":")[2])
        asking = [
            threading.Thread(target=asyncio.run, args=(_opcua(opcua, at_opcua, subscribed, stop),), daemon=True),
            threading.Thread(target=_modbus, args=(modbus, _MOST_UNITS, stop), daemon=True),
            threading.Thread(target=_stream, args=(places["http"], stop), daemon=True),
        ]
        for each in asking:
            each.start()
        began = time.monotonic()
        if not subscribed.wait(_SUBSCRIBED_WITHIN_S):
            sys.exit(f"OPC UA: the values were not subscribed within {_SUBSCRIBED_WITHIN_S} s")
        print(f"opcua: {LINES * DRIVES * (len(VALUES) + 1)} values subscribed in {time.monotonic() - began:.1f} s")
        time.sleep(5)
        for ages in (at_mqtt, at_sparkplug, at_opcua):
            ages.seconds.clear()
        own, of_drives, of_broker = time.process_time(), usage(simulated.pid), usage(broker)
        full = _share(server, told, given.seconds)
        stop.set()
        asking[0].join(10)
        for client in clients:
            with suppress(OSError):
                client.disconnect()
        print(f"with all doors: {full[2]:.0f} reads/s, {full[0]:.2f} of a core, {full[1]:.0f} MiB")
        wanted = LINES * DRIVES * (len(VALUES) + 1)
        print(f"beyond those of the first: {full[0] - alone[0]:.2f} of a core; wanted are {wanted} reads/s")
        print(f"mqtt ({given.messages}): {at_mqtt.told()}")
        print(f"opcua (interval 100 ms): {at_opcua.told()}")
        print(f"sparkplug: {len(at_sparkplug.seconds)} messages")
        shares = [
            (time.process_time() - own) / given.seconds,
            *(
                (usage(pid).processor_s - before.processor_s) / given.seconds
                for pid, before in ((simulated.pid, of_drives), (broker, of_broker))
            ),
        ]
        print("of a core: clients {:.2f}, virtual drives {:.2f}, broker {:.2f}".format(*shares))


if __name__ == "__main__":
    main()
