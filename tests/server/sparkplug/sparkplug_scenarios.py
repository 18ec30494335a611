"""Scenarios of an edge node, played with a real broker and virtual drives; each returns the traffic that was observed.

SHOWN gives the assertions that one scenario exercises, besides those that hold for every message.
"""

import asyncio
import time
from contextlib import AsyncExitStack, asynccontextmanager
from types import SimpleNamespace

from served_core import ENGINEER, asked
from sparkplug_grader import Seen
from sparkplug_listener import Wire, listening
from sparkplug_plant import REBIRTH, command, door_of, end, gateway

from drivecomm.server import LineSnapshot

SHOWN = {
    "drive_silent_and_back": ["operational-behavior-device-ddeath"],
    "rebirth": [
        "operational-behavior-data-commands-rebirth-action-1", "operational-behavior-data-commands-rebirth-action-2",
    ],
    "primary_host": [
        "message-flow-edge-node-birth-publish-phid-wait", "message-flow-edge-node-birth-publish-phid-wait-id",
        "message-flow-edge-node-birth-publish-phid-wait-online",
        "message-flow-edge-node-birth-publish-phid-wait-timestamp",
        "message-flow-edge-node-birth-publish-phid-offline", "operational-behavior-edge-node-birth-sequence-wait",
        "operational-behavior-edge-node-termination-host-offline",
        "operational-behavior-edge-node-termination-host-offline-timestamp",
    ],
    "two_brokers": [
        "operational-behavior-edge-node-termination-host-offline-reconnect",
        "operational-behavior-primary-application-state-with-multiple-servers-walk",
        "operational-behavior-primary-application-state-with-multiple-servers-single-server",
    ],
}  # fmt: skip


@asynccontextmanager
async def shown(tmp_path, broker, **keys):
    """Run a gateway with a wire and a listener; yield all three."""
    async with listening(broker.port) as host, Wire(broker.port) as wire, AsyncExitStack() as stack:
        async with gateway(tmp_path, door_of(wire.url, **keys)) as served:
            one = SimpleNamespace(host=host, wire=wire, stack=stack, served=served, broker=broker, keys=keys)
            one.seen = lambda: Seen(list(host.heard), list(wire.packets), host="host" in keys)
            yield one
        # The listener has to receive the last messages as well.
        await asyncio.sleep(0.2)


async def born(one, births=1):
    await one.host.until(lambda: len(one.host.of("NBIRTH")) >= births)
    since = one.host.of("NBIRTH")[-1].at
    await one.host.until(lambda: {each.device for each in one.host.of("DBIRTH") if each.at >= since} == {"pump", "fan"})


async def started(one, percent=40):
    """Start the pump with a reference, by a local program."""
    for verb, arguments in (("set_reference", {"percent": percent}), ("start", {})):
        answer = await asked(one.served.core, ENGINEER, "pump", verb, arguments=arguments)
        assert answer.error is None


async def start_and_values(tmp_path, broker):
    """Play the start of a gateway, changed values, a failed line, and an orderly shutdown."""
    async with shown(tmp_path, broker) as one:
        await born(one)
        assert (
            await asked(one.served.core, ENGINEER, "pump", "set_reference", arguments={"percent": 40})
        ).error is None
        await started(one)
        await one.host.until(lambda: one.host.value("pump", "Status/Running") is True)
        await one.host.until(lambda: (one.host.value("pump", "Values/output_frequency") or 0) > 0)
        one.served.control.order("trip", drive="fan", code=4)
        await one.host.until(lambda: one.host.value("fan", "Status/Fault") is True)
        assert one.host.value("fan", "Status/State") == "fault"
        await one.host.until(lambda: one.host.value("", "Lines/yard/Up") is True)
        lines = [LineSnapshot(name=name, port="", up=name != "yard") for name in ("hall", "yard")]
        one.served.plant.lines = lambda: lines
        await one.host.until(lambda: one.host.value("", "Lines/yard/Up") is False)
    return one.seen()


async def drive_silent_and_back(tmp_path, broker):
    """Play a drive that loses its power and gets it back."""
    async with shown(tmp_path, broker) as one:
        await born(one)
        one.served.control.order("power", drive="fan", state="off")
        await one.host.until(lambda: one.host.of("DDEATH"))
        died = one.host.of("DDEATH")[0]
        assert (died.device, len(died.message.metrics)) == ("fan", 0)
        await asyncio.sleep(0.5)
        assert not [each for each in one.host.of("DDATA", device="fan") if each.at > died.at]
        one.served.control.order("power", drive="fan", state="on")
        await one.host.until(lambda: [each for each in one.host.of("DBIRTH", device="fan") if each.at > died.at])
        assert len(one.host.of("NBIRTH")) == 1
    return one.seen()


async def rebirth(tmp_path, broker):
    """Play several rebirth requests of a host in quick succession, while values keep changing."""
    async with shown(tmp_path, broker) as one:
        await born(one)
        await started(one)
        await one.host.until(lambda: one.host.value("pump", "Status/Running") is True)
        before = len(one.host.heard)
        for _ in range(5):
            await one.host.command("", command(*REBIRTH))
        await born(one, births=2)
        kinds = [each.kind for each in one.host.heard[before:] if each.kind in ("NBIRTH", "DBIRTH", "DDATA")]
        first = kinds.index("NBIRTH")
        assert kinds[first : first + 3] == ["NBIRTH", "DBIRTH", "DBIRTH"]
        await asyncio.sleep(2.5)
        # Requests in quick succession cause one rebirth.
        assert len(one.host.of("NBIRTH")) <= 3
        numbers = {each.metric("bdSeq").long_value for each in one.host.of("NBIRTH")}
        assert numbers == {0}
    return one.seen()


async def primary_host(tmp_path, broker):
    """Play a primary host that is missing, appears, is reported offline by an old message, leaves, and returns."""
    async with shown(tmp_path, broker, host="scada") as one:
        now = round(time.time() * 1000)
        await one.host.until(lambda: one.wire.of("SUBSCRIBE"))
        await one.host.host(online=False, time_ms=now)
        await one.host.client.publish("spBv1.0/STATE/another", '{"online": true, "timestamp": 9999999999999}', qos=1)
        await one.host.client.publish("spBv1.0/STATE/scada", b"ONLINE", qos=1)
        await one.host.host(online=True, time_ms=now - 1)
        await asyncio.sleep(0.5)
        assert not one.host.of("NBIRTH")
        await one.host.host(online=True, time_ms=now)
        await born(one)
        await one.host.host(online=False, time_ms=now - 1)
        await asyncio.sleep(0.5)
        assert not one.host.of("NDEATH")
        await one.host.host(online=False, time_ms=now + 1)
        await one.host.until(lambda: one.host.of("NDEATH") and one.wire.of("DISCONNECT"))
        await one.host.until(lambda: len(one.wire.of("CONNECT")) >= 2)
        await asyncio.sleep(0.5)
        assert len(one.host.of("NBIRTH")) == 1
        await one.host.host(online=True, time_ms=now + 2)
        await born(one, births=2)
    return one.seen()


async def clean_end(tmp_path, broker, **keys):
    """Play an orderly shutdown of the gateway."""
    async with shown(tmp_path, broker, **keys) as one:
        await born(one)
        await end(one.served.task)
        await one.host.until(lambda: one.host.of("NDEATH"))
    return one.seen()


async def clean_end_of_3(tmp_path, broker):
    """Play an orderly shutdown of the gateway with MQTT 3.1.1."""
    return await clean_end(tmp_path, broker, version="3.1.1")


async def outage(tmp_path, broker):
    """Play a broker that is killed while values change, and restarts; hosts receive the missed values."""
    async with shown(tmp_path, broker) as one:
        await born(one)
        assert (
            await asked(one.served.core, ENGINEER, "pump", "set_reference", arguments={"percent": 80})
        ).error is None
        await started(one)
        await one.host.until(lambda: (one.host.value("pump", "Values/output_frequency") or 0) > 0)
        async with one.wire.away():
            broker.end()
            await asyncio.sleep(1.0)
            lost_ms = round(time.time() * 1000)
            await asyncio.sleep(1.0)
            broker.start()
            again = await one.stack.enter_async_context(listening(broker.port))
        await again.until(lambda: again.of("NBIRTH"))
        missed = await again.until(
            lambda: [
                each for each in again.values("pump", "Values/output_frequency", historical=True) if each[0] > lost_ms
            ]
        )
        times = [each for each, _ in again.values("pump", "Values/output_frequency", historical=True)]
        assert times == sorted(times)
        # The history also repeats values sent just before the broker was killed, which may have been lost.
        assert times[0] < lost_ms - 1000
        assert all(value is not None for _, value in missed)
        assert again.of("NBIRTH")[0].metric("bdSeq").long_value >= 1
        one.host.heard += again.heard
    return one.seen()


async def two_brokers(tmp_path, broker, other):
    """Play a primary host that leaves one broker and appears on the other."""
    async with listening(broker.port) as one, listening(other.port) as two:
        await one.host(online=True)
        await two.host(online=False)
        async with gateway(tmp_path, door_of(broker.url, other.url, host="scada")):
            await one.until(lambda: one.of("DBIRTH"))
            await two.host(online=True)
            await asyncio.sleep(0.5)
            # The edge node uses one broker at a time.
            assert not two.of("NBIRTH")
            await one.host(online=False)
            await one.until(lambda: one.of("NDEATH"))
            await two.until(lambda: two.of("DBIRTH"))
            assert one.of("NDEATH")[0].at < two.of("NBIRTH")[0].at
            # The primary host returns to the first broker.
            await one.host(online=True)
            await two.host(online=False)
            await one.until(lambda: len(one.of("NBIRTH")) == 2)
            numbers = [each.metric("bdSeq").long_value for each in one.of("NBIRTH") + two.of("NBIRTH")]
            assert numbers == [0, 2, 1]
    return Seen(list(one.heard), [])


ALONE = [
    start_and_values, drive_silent_and_back, rebirth, primary_host, clean_end, clean_end_of_3, outage,
]  # fmt: skip
