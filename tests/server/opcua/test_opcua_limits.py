"""Clients that flood, stall or send garbage: they are disconnected, and others see no delay."""

import asyncio
import struct
import time
from contextlib import suppress

import pytest
from asyncua import Client, ua
from served_opcua import call, node, reads_good, until

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.delay import Delay

pytestmark = pytest.mark.soak

STATE = "drives/pump/Status/State"


def hello(buffers=65535, url=b"opc.tcp://x/"):
    body = struct.pack("<IIIIII", 0, buffers, buffers, 0, 0, len(url)) + url
    return b"HELF" + struct.pack("<I", 8 + len(body)) + body


async def is_cut_off(reader, seconds=5):
    """Return whether the server closes the connection within this time; replies before that are ignored."""
    with suppress(ConnectionError):
        async with asyncio.timeout(seconds):
            while await reader.read(65536):
                pass
    return True


@pytest.mark.parametrize(
    "said",
    [
        b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"\x00" * 64,
        # A message with a declared length of four gigabytes, which asyncua without our limits would buffer.
        b"MSGF" + b"\xff\xff\xff\xff" + b"x" * 10_000,
        b"HELF" + struct.pack("<I", 4) + b"x" * 16,
        b"MSGF" + struct.pack("<I", 9) + b"x",
        b"MSGF" + struct.pack("<I", 200) + b"\x01" * 192,
        b"OPNF" + struct.pack("<I", 200) + b"\xff" * 192,
        hello(buffers=16),
        hello(buffers=0),
    ],
    ids=["http", "zeros", "four gigabytes", "no body", "half a header", "no channel", "garbage", "16 bytes", "none"],
)
def test_garbage_closes_the_connection(door, said):
    async def test(one):
        reader, writer = await asyncio.open_connection("127.0.0.1", one.door.port)
        writer.write(said)
        assert await is_cut_off(reader)
        writer.close()
        async with one.client("vera") as vera:
            await reads_good(vera, STATE)

    door.run(test)


def test_newcomer_replaces_the_oldest_connection_without_a_user(door):
    async def test(one):
        async with one.client("otto") as otto:
            most = limits.CONNECTIONS.of_address
            idle = [await asyncio.open_connection("127.0.0.1", one.door.port) for _ in range(most - 1)]
            async with one.client("vera") as vera:
                await reads_good(vera, STATE)
                assert await is_cut_off(idle[0][0])
            assert await call(otto, "Stop") == ("Good", ["done", ""])
            for _, writer in idle:
                writer.close()

    door.run(test)


def test_flood_of_one_client_does_not_delay_a_stop_of_another(door):
    async def test(one):
        async with one.client("vera") as vera, one.client("otto") as otto:
            wanted = [node(vera, STATE)] * 2_000
            flooding = [asyncio.create_task(flood(vera, wanted)) for _ in range(8)]
            await asyncio.sleep(0.5)
            took = []
            for _ in range(5):
                begun = time.monotonic()
                assert await call(otto, "Stop") == ("Good", ["done", ""])
                took.append(time.monotonic() - begun)
            for each in flooding:
                each.cancel()
            # A stop takes some tenths of a second during the flood; the bound allows for a busy machine.
            assert min(took) < 2

    door.run(test)


async def flood(client, wanted):
    with suppress(Exception):
        while True:
            await client.read_values(wanted)


@pytest.mark.soak
def test_client_that_does_not_read_is_disconnected(door):
    async def test(one):
        client = Client(one.url, timeout=60)
        client.set_user("vera")
        client.set_password("view-1234")
        await client.connect()
        client.uaclient.protocol.transport.pause_reading()
        asking = [asyncio.create_task(quietly(client.nodes.server.get_children())) for _ in range(2)]
        wanted = [node(client, "drives/pump/Identification/Title")] * 5_000
        asking += [asyncio.create_task(quietly(client.read_values(wanted))) for _ in range(150)]
        await until(lambda: client.uaclient.protocol.transport is None, 60)
        for each in asking:
            each.cancel()
        with suppress(Exception):
            await asyncio.wait_for(client.disconnect(), 2)

    door.run(test)


async def quietly(awaited):
    with suppress(Exception):
        await awaited


def test_response_size_is_limited(door):
    async def test(one):
        async with one.client("vera") as vera:
            # The node has 200 kB, so that a small request could have a response of hundreds of megabytes.
            schema = vera.get_node(ua.ObjectIds.OpcUa_BinarySchema)
            assert len((await schema.read_value()) or b"") > 50_000
            with pytest.raises(ua.uaerrors.BadResponseTooLarge):
                await vera.read_values([schema] * 200)
            types = ua.BrowseDescription(
                NodeId=ua.NodeId(ua.ObjectIds.BaseDataType), BrowseDirection=ua.BrowseDirection.Both,
                ReferenceTypeId=ua.NodeId(), IncludeSubtypes=True, NodeClassMask=0, ResultMask=63,
            )  # fmt: skip
            params = ua.BrowseParameters(NodesToBrowse=[types] * 9_000)
            with pytest.raises(ua.uaerrors.BadResponseTooLarge):
                await vera.uaclient.browse(params)
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await vera.read_values([node(vera, STATE)] * (limits.NODES_AT_ONCE + 1))

    door.run(test)


def test_number_of_subscriptions_and_items_is_limited(door, monkeypatch):
    monkeypatch.setattr(limits, "ITEMS_OF_SESSION", 500)

    async def test(one):
        async with one.client("vera") as vera:
            made = [await vera.create_subscription(100, None) for _ in range(limits.SUBSCRIPTIONS_OF_SESSION)]
            with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
                await vera.create_subscription(100, None)
            for each in made[1:]:
                await each.delete()
            # asyncua accepts any value: interval 0 sends each change immediately, and this lifetime never expires.
            again = await vera.uaclient.create_subscription(
                ua.CreateSubscriptionParameters(RequestedPublishingInterval=0.0, RequestedLifetimeCount=10**9), None
            )
            assert again.RevisedPublishingInterval == limits.SHORTEST_PUBLISHING_MS
            assert again.RevisedLifetimeCount * again.RevisedPublishingInterval / 1000 <= limits.UNSERVED_S
            wished = ua.MonitoredItemCreateRequest(
                ItemToMonitor=ua.ReadValueId(NodeId=ua.NodeId(STATE, 2), AttributeId=ua.AttributeIds.Value),
                MonitoringMode=ua.MonitoringMode.Reporting,
                RequestedParameters=ua.MonitoringParameters(QueueSize=4_000_000_000),
            )
            params = ua.CreateMonitoredItemsParameters(
                SubscriptionId=again.SubscriptionId, ItemsToCreate=[wished] * 400
            )
            results = await vera.uaclient.create_monitored_items(params)
            assert {each.RevisedQueueSize for each in results} == {limits.QUEUED_VALUES}
            more = await vera.uaclient.create_monitored_items(params)
            assert [each.StatusCode.name for each in more] == ["Good"] * 100 + ["BadTooManyMonitoredItems"] * 300
            change = ua.ModifyMonitoredItemsParameters(
                SubscriptionId=again.SubscriptionId,
                ItemsToModify=[
                    ua.MonitoredItemModifyRequest(
                        MonitoredItemId=number, RequestedParameters=ua.MonitoringParameters(QueueSize=0)
                    )
                    for number in (results[0].MonitoredItemId, 1)
                ],
            )
            known, unknown = await vera.uaclient.modify_monitored_items(change)
            assert known.RevisedQueueSize == limits.QUEUED_VALUES
            assert unknown.StatusCode.name == "BadMonitoredItemIdInvalid"

    door.run(test)


def test_network_delay_is_distinguished_from_a_wrong_clock():
    from datetime import UTC, datetime

    def stamp(seconds):
        return datetime.fromtimestamp(1_000_000_000 + seconds, UTC)

    delay = Delay()
    assert delay.of(stamp(0), 100.0) == 0
    assert delay.of(stamp(1), 101.1) == pytest.approx(0.1)
    assert delay.of(stamp(2), 122.0) == pytest.approx(20)
    assert delay.of(None, 122.0) == 0
    # The clock is set back for good: after two minutes the offset counts as the clock's.
    assert delay.of(stamp(-3600 + 30), 130.0) == pytest.approx(3600)
    assert delay.of(stamp(-3600 + 95), 195.0) == pytest.approx(3600)
    assert delay.of(stamp(-3600 + 160), 260.0) == pytest.approx(0)
    # A clock that is set forward causes no delay.
    assert delay.of(stamp(3600 + 161), 261.0) == 0
