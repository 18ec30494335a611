"""Connections to a real broker: opened, renewed after a loss, and never taken from another gateway."""

import asyncio
import subprocess
import time
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest
from mosquitto import mosquitto, needs_mosquitto, until

from drivecomm.errors import PortError, UsageError
from drivecomm.server import cancel_and_wait
from drivecomm.server.broker import BROKER_KEYS, Broker, BrokerMessage, broker_settings
from drivecomm.server.broker.connection import IdentityTakenOver, connect_to_broker
from drivecomm.tomlfile import TomlTable

pytestmark = needs_mosquitto


def settings(broker, **more):
    table = TomlTable({"broker": broker.url, **more}, "plant.toml")
    return broker_settings(table, table.take(BROKER_KEYS), {"DRIVECOMM_BROKER_HALL": "secret"})


class Door:
    """Door that announces its name on each connection, and records received messages."""

    def __init__(self, broker, name="one", *, topic="plant/bridge", client_id="plant", **more):
        self.name, self.heard, self.told, self.connections = name, [], [], 0
        self.broker = Broker(
            settings(broker, **more), self, topic=topic, client_id=client_id, tell=self.told.append
        )  # fmt: skip

    def will(self):
        return BrokerMessage(topic="plant/state", payload=f"{self.name} lost", retain=True)

    async def serve(self, connection):
        self.connections += 1
        self.connection = connection
        await connection.subscribe("plant/command")
        await connection.publish(BrokerMessage(topic="plant/state", payload=f"{self.name} online", retain=True))
        await asyncio.Event().wait()

    def received(self, received):
        self.heard.append(received)

    async def farewell(self, connection):
        await connection.publish(BrokerMessage(topic="plant/state", payload=f"{self.name} has left", retain=True))


@asynccontextmanager
async def running(*doors):
    tasks = [asyncio.create_task(each.broker.run(lambda: None)) for each in doors]
    try:
        yield tasks
    finally:
        await cancel_and_wait(*tasks)


@asynccontextmanager
async def listening(broker, *topics, **more):
    heard = []
    async with connect_to_broker(settings(broker, **more), "listener", heard.append) as connection:
        await connection.subscribe_with_kept(*topics)
        yield connection, heard


def payloads(heard, topic):
    return [each.payload.decode() for each in heard if each.topic == topic]


@pytest.mark.parametrize("version", ["5", "3.1.1"])
def test_gateway_announces_itself_and_the_broker_publishes_its_will(tmp_path, version):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            door = Door(broker, version=version)
            async with listening(broker, "plant/state") as (_, heard):
                async with running(door):
                    await until(lambda: payloads(heard, "plant/state") == ["one online"])
                assert payloads(heard, "plant/state") == ["one online", "one has left"]
            assert door.told == []

    asyncio.run(test())


@pytest.mark.parametrize("version", ["5", "3.1.1"])
def test_earlier_messages_are_not_received_and_retained_ones_are_marked(tmp_path, version):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            door = Door(broker, version=version)
            async with listening(broker, "nothing") as (connection, _):
                await connection.publish(BrokerMessage(topic="plant/command", payload="old", retain=True))
                async with running(door):
                    await until(lambda: door.connections == 1)
                    await connection.publish(BrokerMessage(topic="plant/command", payload="live"))
                    await connection.publish(BrokerMessage(topic="plant/command", payload="kept", retain=True))
                    await until(lambda: len(door.heard) >= 2 and door.heard[-1].payload == b"kept")
            found = [(each.payload, each.retained) for each in door.heard]
            if version == "5":
                assert found == [(b"live", False), (b"kept", True)]
            else:
                # MQTT 3.1.1 has neither option: only session and time of a command protect against old ones.
                assert found == [(b"old", True), (b"live", False), (b"kept", False)]

    asyncio.run(test())


@pytest.mark.soak
def test_connection_returns_within_five_seconds_and_is_reported_once(tmp_path):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            door = Door(broker)
            async with running(door):
                await until(lambda: door.connections == 1)
                with broker.away():
                    await until(lambda: not door.broker.connected)
                    await asyncio.sleep(2)
                back = time.monotonic()
                await until(lambda: door.connections == 2)
                assert time.monotonic() - back < 5
                await until(lambda: "is connected again" in door.told[-1])
            # At most three events: lost, cannot be reached, connected again.
            assert len(door.told) <= 3, door.told

    asyncio.run(test())


def test_missing_broker_does_not_delay_the_start(tmp_path):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            broker.end()
            door, tried = Door(broker), asyncio.Event()
            task = asyncio.create_task(door.broker.run(tried.set))
            await asyncio.wait_for(tried.wait(), 5)
            assert "cannot be reached" in door.told[0]
            broker.start()
            await until(lambda: door.connections == 1)
            await cancel_and_wait(task)

    asyncio.run(test())


@pytest.mark.soak
@pytest.mark.parametrize("version", ["5", "3.1.1"])
def test_second_gateway_with_the_same_identity_is_refused(tmp_path, version):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            one, two = Door(broker, "one", version=version), Door(broker, "two", version=version)
            async with listening(broker, "plant/state") as (_, heard), running(one):
                await until(lambda: one.connections == 1)
                async with running(two):
                    await until(lambda: two.told)
                    assert "has this identity already" in two.told[0]
                    await asyncio.sleep(1)
                assert (one.connections, one.told, two.connections) == (1, [], 0)
                assert payloads(heard, "plant/state") == ["one online"]

    asyncio.run(test())


@pytest.mark.soak
def test_gateway_that_lost_its_identity_does_not_reconnect(tmp_path):
    """If two gateways connect at the same moment, the broker gives the identity to the later one."""

    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            one, two = Door(broker, "one"), Door(broker, "two")
            async with running(one):
                await until(lambda: one.connections == 1)
                # Simulates a check made before the other gateway connected.
                two.broker._identity.ask = asked_before
                async with running(two):
                    await until(lambda: two.connections == 1)
                    await until(lambda: any("has this identity already" in each for each in one.told), 15)
                    assert (one.connections, two.connections) == (1, 1)

    async def asked_before(_settings):
        return

    asyncio.run(test())


@pytest.mark.soak
def test_gateways_with_one_client_id_do_not_disconnect_each_other_repeatedly(tmp_path):
    """Gateways of different topics cannot find each other, and the broker allows one client of each id."""

    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            one, two = Door(broker, "one", topic="hall/one"), Door(broker, "two", topic="hall/two")
            async with running(one, two):
                await until(lambda: any("different client_id" in each for each in one.told + two.told), 30)
                before = one.connections + two.connections
                await asyncio.sleep(2)
                assert one.connections + two.connections <= before + 1

    asyncio.run(test())


def test_session_taken_over_reason_code_is_understood():
    """MQTT 5 has a reason code for a taken client id.

    The test plays the broker, since some real brokers do not send the code.
    """

    async def play(reader, writer):
        await reader.read(100)
        writer.write(bytes.fromhex("20 03 00 00 00"))
        await asyncio.sleep(0.2)
        writer.write(bytes.fromhex("E0 02 8E 00"))
        await writer.drain()
        await reader.read(100)
        writer.close()

    async def test():
        async with await asyncio.start_server(play, "127.0.0.1", 0) as server:
            place = SimpleNamespace(url=f"mqtt://127.0.0.1:{server.sockets[0].getsockname()[1]}")
            async with connect_to_broker(settings(place), "plant", print) as connection:
                with pytest.raises(IdentityTakenOver):
                    await asyncio.wait_for(connection.lost(), 5)

    asyncio.run(test())


@pytest.mark.soak
def test_identity_of_a_killed_gateway_is_free_for_the_next(tmp_path):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            async with listening(broker, "nothing") as (connection, _):
                holder = '{"instance":"dead","host":"elsewhere","pid":1}'
                await connection.publish(BrokerMessage(topic="plant/bridge/holder", payload=holder, retain=True))
                door = Door(broker)
                async with running(door):
                    await until(lambda: door.connections == 1, 5)
                assert door.told == []

    asyncio.run(test())


def test_wrong_password_is_reported_without_the_password(tmp_path):
    folder = tmp_path / "broker"
    folder.mkdir()
    passwords = folder / "passwords"
    made = ["mosquitto_passwd", "-b", "-c", str(passwords), "hall", "another"]
    subprocess.run(made, check=True, capture_output=True, timeout=30)

    async def test():
        with mosquitto(folder, "allow_anonymous false", f"password_file {passwords}") as broker:
            with pytest.raises(PortError, match="refuses hall") as refused:
                async with connect_to_broker(settings(broker, user="hall", password="@hall"), "c", print):
                    pass
            assert "secret" not in str(refused.value)
            with pytest.raises(UsageError, match="there is no password @other"):
                async with connect_to_broker(settings(broker, user="hall", password="@other"), "c", print):
                    pass

    asyncio.run(test())


def test_response_topic_of_a_command_receives_the_reply(tmp_path):
    async def test():
        with mosquitto(tmp_path / "broker") as broker:
            door = Door(broker)
            async with listening(broker, "plant/response", "mine") as (connection, heard), running(door):
                await until(lambda: door.connections == 1)
                await asyncio.to_thread(
                    subprocess.run,
                    ["mosquitto_pub", "-p", str(broker.port), "-V", "5", "-t", "plant/command", "-m", "do", "-q", "1",
                     "-D", "publish", "response-topic", "mine", "-D", "publish", "correlation-data", "7"],
                    check=True, timeout=20,
                )  # fmt: skip
                await until(lambda: door.heard)
                await door.connection.answer(door.heard[0], BrokerMessage(topic="plant/response", payload="done"))
                await until(lambda: len(heard) == 2)
                assert payloads(heard, "plant/response") == payloads(heard, "mine") == ["done"]
                assert next(each for each in heard if each.topic == "mine").correlation == b"7"
            del connection

    asyncio.run(test())


@pytest.mark.soak
def test_connection_closed_with_unsent_data_leaves_no_error_in_the_event_loop(tmp_path):
    async def scenario(broker):
        wrong = []
        asyncio.get_running_loop().set_exception_handler(lambda _loop, context: wrong.append(context["message"]))
        async with connect_to_broker(settings(broker), "plant", lambda _: None) as connection:
            publishing = asyncio.create_task(
                connection.publish(BrokerMessage(topic="plant/much", payload=b"0" * 50_000_000))
            )
            await asyncio.sleep(0)
            # The event loop is about to watch the socket for room; the socket closes before that happens.
            connection._client._client._sock_close()
            await asyncio.sleep(0.1)
            publishing.cancel()
        return wrong

    with mosquitto(tmp_path) as broker:
        assert asyncio.run(scenario(broker)) == []
