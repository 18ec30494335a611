"""Peers that stall, flood, send garbage or never read: each loses its own connection and affects no other."""

import socket
import struct
import sys
import time
from contextlib import ExitStack, suppress

import pytest
from fake_plant import served, value
from fake_units import table
from raw_master import Master, Refused, until

from drivecomm.server import Bounds
from drivecomm.server.modbus_tcp import connections, modbus_tcp_door

OF_ADDRESS = 32
READ = b"\x04\x00\x01\x00\x05"


@pytest.fixture
def connect(serve):
    return serve()


def answers(master):
    """Return whether the door replies; an exception reply for a missing value counts as well."""
    try:
        master.read(0, 1)
    except Refused:
        return True
    return True


@pytest.mark.parametrize("pieces", [1, 2, 7, 12])
def test_telegram_in_pieces_is_answered(connect, pieces):
    with connect() as master:
        frame = master.frame(b"\x04\x00\x00\x00\x01")
        step = -(-len(frame) // pieces)
        for place in range(0, len(frame), step):
            master.socket.sendall(frame[place : place + step])
            time.sleep(0.01)
        assert master.receive()[1] == b"\x04\x02\x00\x01"


def test_many_telegrams_in_one_segment_are_answered_in_order(connect):
    with connect() as master:
        frames = [master.frame(b"\x04\x00\x00\x00\x01") for _ in range(300)]
        master.socket.sendall(b"".join(frames))
        for frame in frames:
            head, content = master.receive()
            assert head[:2] == frame[:2]
            assert content == b"\x04\x02\x00\x01"


@pytest.mark.parametrize(
    "garbage",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack(">HHHB", 1, 1, 6, 1) + READ,
        struct.pack(">HHHB", 1, 0, 1, 1),
        struct.pack(">HHHB", 1, 0, 0, 1),
        struct.pack(">HHHB", 1, 0, 255, 1),
        struct.pack(">HHHB", 1, 0, 65535, 1),
        b"\x16\x03\x01\x02\x00\x01\x00\x01",
        bytes([255]) * 100_000,
    ],
    ids=["http", "other-protocol", "no-content", "no-unit", "too-long", "far-too-long", "tls", "ones"],
)
def test_garbage_closes_the_connection(connect, garbage):
    with connect() as master, connect() as other:
        with suppress(ConnectionError):
            master.socket.sendall(garbage)
        assert master.is_cut_off()
        assert answers(other)


def test_half_closed_connection_gets_its_reply(connect):
    with connect() as master:
        master.socket.sendall(master.frame(b"\x04\x00\x00\x00\x01"))
        master.socket.shutdown(socket.SHUT_WR)
        assert master.receive()[1] == b"\x04\x02\x00\x01"
        assert master.is_cut_off()


@pytest.mark.soak
def test_connection_without_a_first_request_is_closed(connect, monkeypatch):
    monkeypatch.setattr(connections, "FIRST_REQUEST_S", 0.2)
    with connect() as master, connect() as other:
        assert answers(other)
        master.socket.sendall(b"\x00\x01\x00")
        assert master.is_cut_off()
        assert answers(other)


@pytest.mark.soak
def test_idle_connection_is_closed(connect, monkeypatch):
    monkeypatch.setattr(connections, "IDLE_S", 0.2)
    with connect() as master:
        assert answers(master)
        assert master.is_cut_off()


@pytest.mark.soak
def test_client_that_never_reads_is_disconnected(plant, connect, monkeypatch):
    monkeypatch.setattr(connections, "NOT_READING_S", 0.3)
    plant.change(value("pump", "output_frequency", "10"))
    with connect() as master, connect() as other:
        until(lambda: _is_there(other))
        frames = b"".join(master.frame(b"\x04\x00\x00\x00\x78") for _ in range(1000))
        master.socket.settimeout(0.2)

        def is_cut_off():
            try:
                master.socket.send(frames)
            except TimeoutError:
                return False
            except ConnectionError:
                return True

        until(is_cut_off, 60)
        assert answers(other)


def test_full_door_refuses_a_newcomer_while_all_clients_are_active(connect):
    masters = [connect() for _ in range(OF_ADDRESS)]
    try:
        assert all(answers(each) for each in masters)
        with connect() as one_more:
            assert one_more.is_cut_off()
        assert all(answers(each) for each in masters)
        masters.pop().close()

        def is_let_in():
            with connect() as master:
                try:
                    return answers(master)
                except (EOFError, ConnectionError):
                    return False

        until(is_let_in)
    finally:
        for each in masters:
            each.close()


def test_newcomer_replaces_the_oldest_client_without_a_request(connect):
    with ExitStack() as stack:
        silent = [stack.enter_context(connect()) for _ in range(2)]
        assert all(answers(stack.enter_context(connect())) for _ in range(OF_ADDRESS - 2))
        for oldest in silent:
            assert answers(stack.enter_context(connect()))
            assert oldest.is_cut_off()


@pytest.mark.skipif(sys.platform == "darwin", reason="a Mac has no addresses beside 127.0.0.1")
def test_commander_replaces_an_active_stranger(plant):
    door = modbus_tcp_door(table(commands_from=["127.0.0.1"]))
    door.connections = Bounds(8, 4)
    with served(door, plant), ExitStack() as stack:
        strangers = [stack.enter_context(Master(door.port, address=f"127.0.0.{2 + n % 2}")) for n in range(8)]
        assert all(answers(each) for each in strangers)
        assert stack.enter_context(Master(door.port, address="127.0.0.4")).is_cut_off()
        known = [stack.enter_context(Master(door.port)) for _ in range(4)]
        assert all(answers(each) for each in known)
        assert all(each.is_cut_off() for each in strangers[:4])
        assert all(answers(each) for each in (*known, *strangers[4:]))
        assert stack.enter_context(Master(door.port)).is_cut_off()
        known[0].close()
        until(lambda: _is_let_in(door.port))


def _is_let_in(port):
    with Master(port) as master:
        try:
            return answers(master)
        except (EOFError, ConnectionError):
            return False


def test_many_aborted_connections_do_not_affect_another(connect):
    with connect() as other:
        for _ in range(200):
            gone = connect()
            gone.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            gone.close()
        assert answers(other)


def test_flood_of_one_master_does_not_delay_another(plant, connect):
    """The flooding master gets one turn at a time, so the other master's replies do not queue behind the flood."""
    plant.change(value("pump", "output_frequency", "10"))
    with connect() as flood, connect() as master:
        until(lambda: _is_there(master))
        flood.socket.setblocking(False)
        frames = b"".join(flood.frame(b"\x04\x00\x00\x00\x78") for _ in range(5000))
        took = []
        for _ in range(30):
            try:
                flood.socket.send(frames)
                flood.socket.recv(1 << 20)
            except BlockingIOError:
                pass
            began = time.monotonic()
            master.read(8, 2)
            took.append(time.monotonic() - began)
        # Serving the whole flood first would take seconds.
        assert sorted(took)[len(took) // 2] < 0.2


def _is_there(master):
    try:
        return master.float(8) == 10
    except Refused:
        return False


def test_door_closes_with_open_connections(plant):
    door = modbus_tcp_door(table())
    with served(door, plant) as serving, Master(door.port) as master, Master(door.port) as half:
        half.socket.sendall(b"\x00\x01")
        assert answers(master)
        serving.end()
        assert serving.ended_s < 1
        assert master.is_cut_off()
        assert half.is_cut_off()


def test_telegram_of_maximum_length_is_accepted(connect):
    with connect() as master:
        with pytest.raises(Refused) as caught:
            master.exchange(b"\x10" + bytes(252))
        assert caught.value.code == 3
        assert answers(master)
