"""Many messages and large ones, both ways: none is lost, cut or stuck, however the socket takes and gives them."""

import asyncio
import shutil
import socket
import threading

import paho.mqtt.client as mqtt
import pytest
from mosquitto import mosquitto, needs_mosquitto, until
from test_broker_tls import certificate

from drivecomm.errors import LinkDownError
from drivecomm.server.broker import BROKER_KEYS, Message, broker_settings
from drivecomm.server.broker.buffered import BufferedSocket
from drivecomm.server.broker.client import IN_FLIGHT
from drivecomm.server.broker.connection import connected
from drivecomm.tomlfile import Table

SIZES = (0, 1, 100, 16_383, 16_384, 70_000, 300_000)


def settings(**said):
    table = Table(said, "x.toml")
    return broker_settings(table, table.take(BROKER_KEYS))


async def there_and_back(said, qos):
    """Publish to oneself, and compare."""
    heard, sent = [], [bytes([number % 256]) * SIZES[number % len(SIZES)] for number in range(210)]
    async with connected(settings(**said), "client", heard.append) as connection:
        await connection.subscribe("a", qos=qos)
        for message in [await connection.hand_over(Message(topic="a", payload=each, qos=qos)) for each in sent]:
            await message.arrived()
        await until(lambda: len(heard) == len(sent), 30)
    assert [each.payload for each in heard] == sent


@needs_mosquitto
@pytest.mark.parametrize("version", ["5", "3.1.1"])
@pytest.mark.parametrize("qos", [0, 1])
def test_messages_of_all_sizes_come_back_whole_and_in_order(tmp_path, version, qos):
    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(there_and_back({"broker": broker.url, "version": version}, qos))


@needs_mosquitto
@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl, which makes the certificates, is missing")
@pytest.mark.parametrize("qos", [0, 1])
def test_the_same_over_tls(tmp_path, qos):
    folder = tmp_path / "broker"
    folder.mkdir()
    certificate(folder, "broker")
    with mosquitto(folder, f"certfile {folder / 'broker.pem'}", f"keyfile {folder / 'broker.key'}") as broker:
        said = {"broker": f"mqtts://localhost:{broker.port}", "authority": str(folder / "broker.pem")}
        asyncio.run(there_and_back(said, qos))


@needs_mosquitto
def test_a_broker_that_stands_still_gets_no_more_than_may_be_on_its_way(tmp_path):
    async def publish(connection, number, handed):
        for _ in range(number):
            await connection.hand_over(Message(topic="a", payload="1"))
            handed.append(1)

    async def test(broker):
        handed = []
        async with connected(settings(broker=broker.url), "client", print) as connection:
            with broker.standing_still():
                task = asyncio.create_task(publish(connection, 2 * IN_FLIGHT, handed))
                await asyncio.sleep(0.3)
                assert len(handed) == IN_FLIGHT
            await asyncio.wait_for(task, 10)

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_a_broker_that_does_not_say_that_it_has_a_message_is_a_lost_connection(tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.server.broker.client.WITHIN_S", 0.3)

    async def test(broker):
        async with connected(settings(broker=broker.url), "client", print) as connection:
            with broker.standing_still(), pytest.raises(LinkDownError, match="did not answer in time"):
                await connection.publish(Message(topic="a", payload="1"))

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_what_is_published_goes_out_without_a_turn_of_the_event_loop(tmp_path):
    async def test(broker, heard):
        async with connected(settings(broker=broker.url), "client", print) as connection:
            await connection.hand_over(Message(topic="a", payload="1"))
            assert heard.wait(5)

    with mosquitto(tmp_path / "broker") as broker:
        heard, subscribed = threading.Event(), threading.Event()
        listener = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        listener.on_message = lambda *_: heard.set()
        listener.on_subscribe = lambda *_: subscribed.set()
        listener.connect("127.0.0.1", broker.port)
        listener.subscribe("a")
        listener.loop_start()
        assert subscribed.wait(5)
        asyncio.run(test(broker, heard))
        listener.disconnect()
        listener.loop_stop()


def test_a_buffered_socket_gives_what_came_in_any_pieces_and_lets_others_have_their_turn_in_between():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        buffered = BufferedSocket(ours)
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        theirs.sendall(b"abcdef")
        assert (buffered.recv(1), buffered.pending(), buffered.recv(2), buffered.recv(9)) == (b"a", 5, b"bc", b"def")
        theirs.sendall(b"g")
        # Whoever reads until there is no more comes to an end, whatever comes meanwhile.
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        assert buffered.recv(1) == b"g"
        theirs.close()
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        assert buffered.recv(1) == b""
        assert buffered.fileno() == ours.fileno()
