"""A served line with listeners: which bytes reach whom; listeners disturb nothing."""

import json
import socket
import time
from contextlib import ExitStack, closing, suppress

import pytest

from drivecomm.errors import UsageError
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.testing import ServingThread
from drivecomm.virtual import PlantServer, VirtualPlant

ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")
VALUE = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48")


@pytest.fixture
def connect():
    """Serve a drive on a line with listeners; yield a function that connects a client."""
    planned = Plant(
        lines=(PlantLine(name="hall", listen="tcp:127.0.0.1:0", listeners=True, paced=False),),
        drives=(DriveConfig(protocol="vabus", address=1, line="hall"),),
    )
    server = PlantServer(VirtualPlant(planned))
    with ExitStack() as opened:
        opened.enter_context(closing(ServingThread(server)))
        port = int(server.addresses["hall"].rpartition(":")[2])

        def connected():
            client = socket.create_connection(("127.0.0.1", port), timeout=5)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return opened.enter_context(client)

        yield connected


def taken(client, length):
    data = b""
    while len(data) < length:
        data += client.recv(length - len(data)) or pytest.fail("the line was closed")
    return data


def ask(master):
    master.sendall(ENQUIRY)
    return taken(master, len(VALUE))


def hears_nothing(client):
    client.settimeout(0.2)
    with pytest.raises(TimeoutError):
        client.recv(1)
    client.settimeout(5)
    return True


def test_listeners_receive_both_sides_and_the_master_receives_only_replies(connect):
    first, master, late = connect(), connect(), connect()
    assert ask(master) == VALUE
    assert ask(master) == VALUE
    for listener in (first, late):
        assert taken(listener, 54) == (ENQUIRY + VALUE) * 2
    assert hears_nothing(master)


def test_bytes_of_a_listener_are_discarded_while_a_master_is_connected(connect):
    listener, master = connect(), connect()
    assert ask(master) == VALUE
    taken(listener, 27)
    listener.sendall(b"\x04A\x0020548008000004B0\x03D" + ENQUIRY)
    assert hears_nothing(master)
    assert ask(master) == VALUE
    assert taken(listener, 27) == ENQUIRY + VALUE


def test_listener_becomes_the_master_when_the_master_has_left(connect):
    listener, master = connect(), connect()
    assert ask(master) == VALUE
    taken(listener, 27)
    master.close()
    # Bytes sent before the server has noticed the end of the master are discarded.
    listener.settimeout(0.2)
    for _ in range(25):
        listener.sendall(ENQUIRY)
        with suppress(TimeoutError):
            assert taken(listener, len(VALUE)) == VALUE
            break
    else:
        pytest.fail("the listener did not become the master")


def test_listener_that_does_not_read_is_disconnected_and_delays_nothing(connect):
    deaf, master = connect(), connect()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    assert all(ask(master) == VALUE for _ in range(300))
    deaf.close()
    assert ask(master) == VALUE


def test_surplus_listeners_are_disconnected_and_the_master_stays(connect):
    master = connect()
    assert ask(master) == VALUE
    crowd = [connect() for _ in range(40)]
    assert ask(master) == VALUE
    heard = 0
    for each in crowd:
        each.settimeout(0.5)
        try:
            heard += each.recv(100) != b""
        except (TimeoutError, ConnectionError):
            continue
    assert heard == 32


def test_listeners_need_a_line_over_tcp(tmp_path):
    for listen in (f"pty:{tmp_path / 'line'}", "rfc2217:127.0.0.1:0"):
        planned = Plant(lines=(PlantLine(name="hall", listen=listen, listeners=True),))
        with pytest.raises(UsageError, match="can have no listeners; let it listen at tcp:HOST:PORT"):
            PlantServer(VirtualPlant(planned))


def test_control_socket_of_a_served_plant_returns_telegrams():
    planned = Plant(
        lines=(PlantLine(name="hall", listen="tcp:127.0.0.1:0"),),
        drives=(DriveConfig(protocol="vabus", address=1, line="hall"),),
    )
    server = PlantServer(VirtualPlant(planned), control="127.0.0.1:0")
    with closing(ServingThread(server)):
        line = server.addresses["hall"].rpartition(":")[2]
        with socket.create_connection(("127.0.0.1", int(line)), timeout=5) as master:
            assert ask(master) == VALUE
        with socket.create_connection(("127.0.0.1", int(server.control.rpartition(":")[2])), timeout=5) as control:
            told = []
            deadline = time.monotonic() + 5
            while len(told) < 2 and time.monotonic() < deadline:
                control.sendall(b'{"order": "telegrams"}\n')
                told = json.loads(control.makefile().readline())["telegrams"]
    assert [each["telegram"].split()[0] for each in told] == ["enquiry", "value"]
