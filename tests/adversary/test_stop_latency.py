"""How many telegrams of its line go out between a stop that is asked for and its own first one, under each flood.

    python tests/adversary/test_stop_latency.py

prints the table. A stop is asked for over a real connection to each door, while others ask for as much as they can.
"""

import asyncio
import sys
import time
from contextlib import suppress
from pathlib import Path

import compressed_time
import pytest
from server_bench import ServerBench, in_this_loop
from server_scripts import Script

from drivecomm.server import ended

MOST_BEHIND = 2
"""Telegrams that may go out after a stop was asked for and before its own, besides the one that is under way."""
DOORS = ("local", "http", "mqtt", "sparkplug", "modbus-tcp")
_KINDS = ("http", "mqtt", "modbus-tcp", "sparkplug")
_WARM_S = 1.0
_CONTROL_VALID = 0x0400


class Wire:
    """What the master sends on the line of the fan."""

    def __init__(self, bench):
        self._plant, self.sent = bench.plant, []
        bench.plant.lines["hall"].line.monitor = self._heard

    def _heard(self, transmission):
        if transmission.sender is None:
            self.sent.append((transmission.began, transmission.data))

    def since(self, began):
        """Return how many telegrams went out before the first stop of the fan since then, and how many ms it took."""
        others = 0
        for at, data in self.sent:
            if at > began:
                if _stops_the_fan(data):
                    return others, 1000 * (at - began)
                # An end of an exchange in VABus is no telegram of its own.
                others += len(data) > 1
        return None


def _stops_the_fan(data):
    # STX, length, address 3 with the mark of the short form, control word.
    is_fan = len(data) >= 8 and data[0] == 2 and data[2] == 0x83
    return is_fan and int.from_bytes(data[-5:-3]) & _CONTROL_VALID != 0


async def _again_and_again(ask):
    while True:
        with suppress(OSError, TimeoutError):
            await ask()


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


async def polls(_):
    return []


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
    polls,
    reads_by_http,
    reads_of_another_drive,
    reads_by_mqtt,
    reads_by_programs,
    a_scan,
    a_doctor,
    stops_of_a_dead_drive,
    stops_of_another_drive,
)


def _asked(script, door):
    if door == "modbus-tcp":
        script.plcs["fan"].stop(standing=True)
        return None
    ask = {
        "local": lambda: script.here.stop("fan"),
        "http": lambda: script.vera.stop("fan"),
        "mqtt": lambda: script.broker.stop("fan"),
        "sparkplug": lambda: script.broker.host_stops("fan"),
    }[door]
    return asyncio.create_task(ask())


async def _measured(folder, clocks, flood, door):
    bench = ServerBench(folder, clocks, _KINDS)
    await bench.open()
    script = Script(bench)
    flooding = []
    try:
        await script.open()
        wire = Wire(bench)
        await script.here.start_here("fan")
        flooding = [asyncio.create_task(each) for each in await flood(script)]
        await asyncio.sleep(_WARM_S)
        assert bench.plant.running("fan")
        began = bench.plant.line_time()
        asked = _asked(script, door)
        end = time.monotonic() + 40
        while (found := wire.since(began)) is None:
            assert time.monotonic() < end, "the stop does not go out"
            await asyncio.sleep(0.01)
        for each in [*flooding, *([asked] if asked else [])]:
            await ended(each)
        return found
    finally:
        for each in flooding:
            await ended(each)
        for plc in script.plcs.values():
            await plc.disconnect()
        await script.close()
        await bench.close()


def measured(flood, door):
    """Return how many telegrams went first, and how many milliseconds that took."""
    clocks = compressed_time.Clocks(f"{flood.__name__} {door}")
    with in_this_loop() as folder:
        return compressed_time.run(clocks, _measured(folder, clocks, flood, door))


@pytest.mark.soak
@pytest.mark.skipif(sys.platform != "linux", reason="it needs descriptors of the Linux kernel")
@pytest.mark.parametrize("flood", FLOODS, ids=lambda each: each.__name__)
def test_a_stop_goes_out_behind_two_telegrams_at_most(flood):
    behind = {door: measured(flood, door)[0] for door in DOORS}
    assert max(behind.values()) <= MOST_BEHIND, behind


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    print(f"{'telegrams of the line before the stop':<40}" + "".join(f"{door:>18}" for door in DOORS))
    for each in FLOODS:
        row = []
        for door in DOORS:
            try:
                row.append("{} ({:.0f} ms)".format(*measured(each, door)))
            except Exception as error:  # noqa: BLE001 - shown in the table
                row.append(f"{type(error).__name__}")
        print(f"{each.__name__.replace('_', ' '):<40}" + "".join(f"{each:>18}" for each in row), flush=True)
