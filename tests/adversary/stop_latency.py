"""Number of telegrams between the request for a stop and its own first telegram, for each kind of flood.

A flood that reaches the line must keep it busy, which is checked; reads at doors may be answered from known values.

    python tests/adversary/stop_latency.py

prints the table. A stop is requested over a real connection to each door, while other clients send as many requests as
they can.
"""

import asyncio
import os
import signal
import struct
import time
from contextlib import suppress

import compressed_time
from opcua_client import call, connected
from server_bench import UNITS, ServerBench, in_this_loop
from server_scripts import Script

from drivecomm.server import cancel_and_wait

DOORS = ("local", "http", "mqtt", "sparkplug", "modbus-tcp", "opcua")
_WARM_S = 1.0
_AT_DOORS_S = 0.02
"""Pause between reads that need no line; without it, the script's time would not pass."""
_CONTROL_VALID = 0x0400
_MANY = ("output_frequency", "output_current", "output_voltage", "dc_link_voltage", "3-41", "3-42", "1-20", "1-23")


class Wire:
    """Record of the master's telegrams on the line of the fan."""

    def __init__(self, bench):
        self.sent, self.heard = [], []
        bench.plant.lines["hall"].line.monitors.append(self._heard)

    def _heard(self, transmission):
        if transmission.sender is None:
            self.sent.append((transmission.began, transmission.data))
        self.heard.append((transmission.began, transmission.ended, transmission.sender is None))

    def busy(self, began, ended):
        """Return the share of this time in which a telegram is under way or its reply is awaited."""
        idle, free_since = 0.0, began
        for first, last, is_request in self.heard:
            if first >= began and last <= ended:
                if is_request and free_since is not None:
                    idle += max(0.0, first - free_since)
                free_since = None if is_request else last
        return 1 - (idle + (ended - free_since if free_since is not None else 0.0)) / (ended - began)

    def since(self, began):
        """Return the number of telegrams and the milliseconds until the next stop of the fan."""
        others = 0
        for at, data in self.sent:
            if at > began:
                if _stops_the_fan(data):
                    return others, 1000 * (at - began)
                # The closing EOT of a VABus exchange does not count as a telegram.
                others += len(data) > 1
        return None


def _stops_the_fan(data):
    # STX, length, address 3 with the mark of the short form, control word.
    is_fan = len(data) >= 8 and data[0] == 2 and data[2] == 0x83
    return is_fan and int.from_bytes(data[-5:-3]) & _CONTROL_VALID != 0


async def _again_and_again(ask, pause_s=0.0):
    while True:
        with suppress(OSError, TimeoutError):
            await ask()
        await asyncio.sleep(pause_s)


async def reads_by_http(script):
    return [_again_and_again(lambda: script.vera.do("fan", "read", parameter="output_frequency")) for _ in range(40)]


async def reads_of_another_drive(script):
    return [_again_and_again(lambda: script.vera.do("pump", "read", parameter="output_frequency")) for _ in range(40)]


async def reads_by_mqtt(script):
    content = {"verb": "read", "arguments": {"parameter": "output_frequency"}}
    ask = lambda: script.broker._ask("drivecomm/plant/fan/command", content)  # noqa: E731
    return [_again_and_again(ask) for _ in range(20)]


async def reads_by_programs(script):
    return [_again_and_again(lambda: script.here.do("fan", "read", parameter="output_frequency")) for _ in range(40)]


async def the_polls(_):
    return []


async def a_full_poll_plan(script):
    before, name, fan = script.bench.file.read_text().partition('name = "fan"')
    many = '", "'.join(_MANY)
    fan = fan.replace('["output_frequency"], period_s = 1', f'["{many}"], period_s = 0.05', 1)
    script.bench.write(before + name + fan)
    os.kill(os.getpid(), signal.SIGHUP)
    await asyncio.sleep(2.0)
    # The change of the plant file has stopped the fan.
    await script.here.start_here("fan")
    return []


async def a_backup(script):
    return [_again_and_again(lambda each=each: script.here.do("fan", "read", parameter=each)) for each in _MANY]


async def values_by_opcua(script):
    client = await connected(script.bench)
    node = client.nodes.server_state
    return [_again_and_again(node.read_value, _AT_DOORS_S) for _ in range(20)]


async def images_by_modbus_tcp(script):
    reader, writer = await asyncio.open_connection("127.0.0.1", script.bench.doors["modbus-tcp"].port)

    async def read():
        for number in range(10):
            writer.write(struct.pack(">HHHBBHH", number, 0, 6, UNITS["fan"], 3, 0, 8))
        for _ in range(10):
            head = await reader.readexactly(6)
            await reader.readexactly(struct.unpack(">H", head[4:])[0])

    return [_again_and_again(read, _AT_DOORS_S)]


async def a_scan(script):
    return [_again_and_again(lambda: script.here.ask("POST", "lines/hall/scan", {}))]


async def a_doctor(script):
    return [_again_and_again(lambda: script.here.ask("POST", "lines/hall/doctor", {}))]


async def stops_of_a_dead_drive(script):
    script.bench.plant.virtual.power_off("pump")
    return [_again_and_again(lambda: script.vera.do("pump", "stop")) for _ in range(20)]


async def stops_of_another_drive(script):
    return [_again_and_again(lambda: script.vera.do("pump", "stop")) for _ in range(20)]


FLOODS = (
    the_polls,
    a_full_poll_plan,
    a_backup,
    values_by_opcua,
    images_by_modbus_tcp,
    reads_by_http,
    reads_of_another_drive,
    reads_by_mqtt,
    reads_by_programs,
    a_scan,
    a_doctor,
    stops_of_a_dead_drive,
    stops_of_another_drive,
)
OF_MANY = (a_full_poll_plan, a_backup)
"""Floods of requests that cannot share a telegram, so that the line is always busy."""


def _asked(script, door, user):
    if door == "modbus-tcp":
        script.plcs["fan"].stop(standing=True)
        return None
    ask = {
        "local": lambda: script.here.stop("fan"),
        "http": lambda: script.vera.stop("fan"),
        "mqtt": lambda: script.broker.stop_by_its_topic("fan"),
        "sparkplug": lambda: script.broker.host_stops("fan"),
        "opcua": lambda: call(user, "Stop", on="drives/fan"),
    }[door]
    return asyncio.create_task(ask())


async def _measured(folder, clocks, flood, door):
    bench = ServerBench(folder, clocks)
    await bench.open()
    script = Script(bench)
    flooding = []
    try:
        await script.open()
        wire = Wire(bench)
        await script.here.start_here("fan")
        flooding = [asyncio.create_task(each) for each in await flood(script)]
        user = await connected(bench)
        await asyncio.sleep(_WARM_S)
        assert bench.plant.running("fan")
        began = bench.plant.line_time()
        busy = wire.busy(began - _WARM_S, began)
        asked = _asked(script, door, user)
        end = time.monotonic() + 40
        while (found := wire.since(began)) is None:
            assert time.monotonic() < end, "the stop does not go out"
            await asyncio.sleep(0.01)
        for each in [*flooding, *([asked] if asked else [])]:
            await cancel_and_wait(each)
        await user.disconnect()
        return *found, busy
    finally:
        for each in flooding:
            await cancel_and_wait(each)
        for plc in script.plcs.values():
            await plc.disconnect()
        await script.close()
        await bench.close()


def measured(flood, door):
    """Return the number of telegrams before the stop, the milliseconds until it, and how busy the line was before."""
    clocks = compressed_time.Clocks(f"{flood.__name__} {door}")
    with in_this_loop() as folder:
        return compressed_time.run(clocks, _measured(folder, clocks, flood, door))


if __name__ == "__main__":
    print(f"{'telegrams of the line before the stop':<40}" + "".join(f"{door:>18}" for door in DOORS))
    for each in FLOODS:
        row = []
        for door in DOORS:
            try:
                row.append("{} ({:.0f} ms, {:.0%})".format(*measured(each, door)))
            except Exception as error:  # noqa: BLE001 - shown in the table
                row.append(f"{type(error).__name__}")
        print(f"{each.__name__.replace('_', ' '):<40}" + "".join(f"{each:>18}" for each in row), flush=True)
