"""Many and large messages in both directions.

No message is lost, cut or stuck, in whatever portions the socket sends and receives the bytes.
"""

import asyncio
import select
import shutil
import socket
import time
from contextlib import contextmanager

import pytest
from mosquitto import mosquitto, needs_mosquitto, until
from test_broker_tls import certificate

from drivecomm.errors import LinkDownError
from drivecomm.server.broker import BROKER_KEYS, BrokerMessage, broker_settings
from drivecomm.server.broker.buffered import BufferedSocket
from drivecomm.server.broker.client import IN_FLIGHT
from drivecomm.server.broker.connection import connect_to_broker
from drivecomm.tomlfile import TomlTable

SIZES = (0, 1, 100, 16_383, 16_384, 70_000, 300_000)


def settings(**said):
    table = TomlTable(said, "x.toml")
    return broker_settings(table, table.take(BROKER_KEYS))


async def there_and_back(said, qos):
    """Publish messages to a topic of the same client, and compare them with the received ones."""
    heard, sent = [], [bytes([number % 256]) * SIZES[number % len(SIZES)] for number in range(210)]
    async with connect_to_broker(settings(**said), "client", heard.append) as connection:
        await connection.subscribe("a", qos=qos)
        for message in [await connection.hand_over(BrokerMessage(topic="a", payload=each, qos=qos)) for each in sent]:
            await message.arrived()
        await until(lambda: len(heard) == len(sent), 30)
    assert [each.payload for each in heard] == sent


@needs_mosquitto
@pytest.mark.parametrize("version", ["5", "3.1.1"])
@pytest.mark.parametrize("qos", [0, 1])
def test_messages_of_all_sizes_arrive_whole_and_in_order(tmp_path, version, qos):
    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(there_and_back({"broker": broker.url, "version": version}, qos))


@pytest.mark.soak
@needs_mosquitto
@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl, which makes the certificates, is missing")
@pytest.mark.parametrize("qos", [0, 1])
def test_messages_of_all_sizes_arrive_whole_over_tls(tmp_path, qos):
    folder = tmp_path / "broker"
    folder.mkdir()
    certificate(folder, "broker")
    with mosquitto(folder, f"certfile {folder / 'broker.pem'}", f"keyfile {folder / 'broker.key'}") as broker:
        said = {"broker": f"mqtts://localhost:{broker.port}", "authority": str(folder / "broker.pem")}
        asyncio.run(there_and_back(said, qos))


@needs_mosquitto
def test_socket_of_the_client_has_tcp_nodelay(tmp_path):
    async def test(broker):
        async with connect_to_broker(settings(broker=broker.url), "client", print) as connection:
            sock = connection._client._client.socket()
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_stalled_broker_limits_the_messages_in_flight(tmp_path):
    async def publish(connection, number, handed):
        for _ in range(number):
            await connection.hand_over(BrokerMessage(topic="a", payload="1"))
            handed.append(1)

    async def test(broker):
        handed = []
        async with connect_to_broker(settings(broker=broker.url), "client", print) as connection:
            with broker.standing_still():
                task = asyncio.create_task(publish(connection, 2 * IN_FLIGHT, handed))
                await asyncio.sleep(0.3)
                assert len(handed) == IN_FLIGHT
            await asyncio.wait_for(task, 10)

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_missing_acknowledgement_counts_as_a_lost_connection(tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.server.broker.client.WITHIN_S", 0.3)

    async def test(broker):
        async with connect_to_broker(settings(broker=broker.url), "client", print) as connection:
            with broker.standing_still(), pytest.raises(LinkDownError, match="did not answer in time"):
                await connection.publish(BrokerMessage(topic="a", payload="1"))

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_each_message_has_its_own_acknowledgement_timeout(tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.server.broker.client.WITHIN_S", 0.4)

    async def test(broker):
        async with connect_to_broker(settings(broker=broker.url), "client", print) as connection:
            await connection.publish(BrokerMessage(topic="a", payload="0"))
            with broker.standing_still():
                began, waited = time.monotonic(), []
                for pause_s in (0.3, 0.0):
                    waited.append(await connection.hand_over(BrokerMessage(topic="a", payload="1")))
                    await asyncio.sleep(pause_s)
                for each, within_s in zip(waited, (0.4, 0.7), strict=True):
                    with pytest.raises(LinkDownError, match="did not answer in time"):
                        await asyncio.wait_for(each.arrived(), 5)
                    assert within_s <= time.monotonic() - began < within_s + 0.25
            await connection.publish(BrokerMessage(topic="a", payload="2"))

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@needs_mosquitto
def test_messages_of_one_event_loop_turn_are_sent_together(tmp_path, monkeypatch):
    sent = []

    async def test(broker):
        async with connect_to_broker(settings(broker=broker.url), "client", print) as connection:
            flush = BufferedSocket.flush
            monkeypatch.setattr(BufferedSocket, "flush", lambda its: sent.append(len(its._unsent)) or flush(its))
            messages = [await connection.hand_over(BrokerMessage(topic="a", payload="1")) for _ in range(IN_FLIGHT)]
            assert not sent
            await asyncio.sleep(0)
            assert [bool(each) for each in sent] == [True]
            for each in messages:
                await each.arrived()

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(test(broker))


@contextmanager
def connected_pair():
    """Yield the two ends of a connection; ours does not block."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as ours:
        theirs, _ = server.accept()
        with theirs:
            ours.setblocking(False)
            yield ours, theirs


def test_buffered_socket_returns_bytes_in_pieces_and_yields_in_between():
    with connected_pair() as (ours, theirs):
        buffered = BufferedSocket(ours)
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        theirs.sendall(b"abcdef")
        assert select.select([ours], [], [], 5)[0]
        assert (buffered.recv(1), buffered.pending(), buffered.recv(2), buffered.recv(9)) == (b"a", 5, b"bc", b"def")
        theirs.sendall(b"g")
        # A read loop ends after the buffered bytes, even if more arrive meanwhile.
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        assert select.select([ours], [], [], 5)[0]
        assert buffered.recv(1) == b"g"
        theirs.close()
        with pytest.raises(BlockingIOError):
            buffered.recv(1)
        assert select.select([ours], [], [], 5)[0]
        assert buffered.recv(1) == b""
        assert buffered.fileno() == ours.fileno()


def test_buffered_socket_sends_several_pieces_together():
    with connected_pair() as (ours, theirs):
        buffered = BufferedSocket(ours)
        assert buffered.flush()
        assert (buffered.send(b"abc"), buffered.send(bytearray(b"de"))) == (3, 2)
        assert not select.select([theirs], [], [], 0.1)[0]
        assert buffered.flush()
        assert theirs.recv(9) == b"abcde"


def test_buffered_socket_keeps_bytes_that_do_not_fit():
    said = bytes(range(256)) * 40_000
    with connected_pair() as (ours, theirs):
        buffered = BufferedSocket(ours)
        assert buffered.send(said) == len(said)
        assert not buffered.flush()
        assert not buffered.flush()
        heard = bytearray()
        while not buffered.flush():
            heard += theirs.recv(1_000_000)
        while len(heard) < len(said):
            heard += theirs.recv(1_000_000)
        assert heard == said


def test_buffered_socket_sends_its_buffer_before_closing():
    with connected_pair() as (ours, theirs):
        buffered = BufferedSocket(ours)
        buffered.send(b"the end")
        buffered.close()
        assert (theirs.recv(9), theirs.recv(9)) == (b"the end", b"")


def test_buffered_socket_drops_its_buffer_after_a_broken_connection():
    with connected_pair() as (ours, theirs):
        buffered = BufferedSocket(ours)
        theirs.close()
        with pytest.raises(OSError, match=r"Broken pipe|reset"):  # noqa: PT012 - the error comes some sends later
            while True:
                ours.send(b"anybody?")
                time.sleep(0.01)
        buffered.send(b"nobody")
        assert buffered.flush()
