"""A door at its connection limit: which connections are closed for a newcomer, and which are never closed."""

import contextlib
import http.client
import json
import time

import pytest
from fake_plant import Client, served, value

from drivecomm.server import Bounds
from drivecomm.server.http import HttpDoor
from drivecomm.tomlfile import TomlTable


@pytest.fixture
def small(plant):
    made = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0", "anonymous": "view"}, "hall.toml"))
    made.connections = Bounds(4, 4)
    with served(made, plant):
        yield made


@pytest.fixture
def stack():
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def connect(small, stack):
    """Return a function that connects, and requests a path with a token if given."""

    def connected(path="", token="", status=200):
        one = stack.enter_context(contextlib.closing(http.client.HTTPConnection("127.0.0.1", small.port, timeout=10)))
        one.connect()
        if path:
            asks(one, path, token, status)
        return one

    return connected


def asks(one, path, token="", status=200):
    one.request("GET", path, headers={"Authorization": f"Bearer {token}"} if token else {})
    answer = one.getresponse()
    assert answer.status == status
    answer.read()


def is_cut_off(one):
    try:
        return one.sock.recv(1) == b""
    except ConnectionError:
        return True


def until(condition):
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def stops(door):
    return Client(door, "ottootto").post("/api/v1/drives/pump/stop", id="1", arguments={}).content["outcome"] == "done"


def test_stop_closes_the_oldest_idle_anonymous_connection(small, connect):
    idle = [connect("/healthz") for _ in range(4)]
    # Another request does not make the connection younger.
    asks(idle[0], "/healthz")
    assert stops(small)
    assert is_cut_off(idle[0])
    for each in idle[1:]:
        asks(each, "/healthz")


@pytest.mark.parametrize("says", [b"", b"GET / HT"], ids=["nothing", "half a request"])
def test_stop_closes_the_oldest_connection_without_a_request(small, connect, says):
    idle = [connect() for _ in range(4)]
    for each in idle:
        each.sock.sendall(says)
    assert stops(small)
    assert is_cut_off(idle[0])
    idle[3].sock.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"[len(says) :])
    assert idle[3].sock.recv(15) == b"HTTP/1.1 200 OK"


def test_stop_closes_an_anonymous_stream(small, stack):
    streams = [stack.enter_context(Client(small).stream()) for _ in range(4)]
    for each in streams:
        each.next("hello")
    assert stops(small)
    with pytest.raises((EOFError, OSError, ValueError)):
        list(iter(streams[0].next, None))


def test_streams_of_users_are_closed_last(small, connect, stack, plant):
    idle = connect("/api/v1/plant", token="annaanna")
    streams = [stack.enter_context(Client(small, "annaanna").stream()) for _ in range(3)]
    assert stops(small)
    assert is_cut_off(idle)
    streams.append(stack.enter_context(Client(small, "annaanna").stream()))
    for each in streams:
        each.next("values")
    # Only one stream is closed, however many others connect.
    strangers = [connect() for _ in range(3)]
    assert stops(small)
    assert all(map(is_cut_off, strangers))
    with pytest.raises((EOFError, OSError, ValueError)):
        list(iter(streams[0].next, None))
    plant.change(value("pump", amount="7"))
    assert [each.next("values").data[0]["reading"]["value"] for each in streams[1:]] == [7] * 3


def test_connection_with_a_running_command_is_never_closed(small, connect, plant):
    waiting = [connect() for _ in range(4)]
    for number, each in enumerate(waiting):
        body = json.dumps({"id": f"w{number}", "arguments": {}})
        each.request("POST", "/api/v1/drives/pump/wait", body, {"Authorization": "Bearer annaanna"})
    until(lambda: len(plant.commands) == 4)
    assert is_cut_off(connect())
    waiting[0].close()
    assert plant.cancelled.wait(10)
    assert stops(small)
    assert [each.sock.fileno() >= 0 for each in waiting[1:]] == [True] * 3


def test_connection_with_a_wrong_token_counts_as_anonymous(small, connect):
    guessing = [connect("/api/v1/plant", token="wrong", status=401) for _ in range(4)]
    assert stops(small)
    assert is_cut_off(guessing[0])
