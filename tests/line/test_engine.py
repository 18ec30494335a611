"""The engine alone: callbacks for readable descriptors, with epoll and with selectors."""

import select
import socket

import pytest

from drivecomm.line import Engine


@pytest.fixture(params=["epoll", "selectors"])
def engine(request, monkeypatch):
    if request.param == "selectors":
        monkeypatch.delattr(select, "epoll", raising=False)
    elif not hasattr(select, "epoll"):
        pytest.skip("this system has no epoll")
    engine = Engine()
    yield engine
    engine.close()


@pytest.fixture
def pairs():
    made = [socket.socketpair() for _ in range(3)]
    yield made
    for pair in made:
        for each in pair:
            each.close()


def heard(engine, pairs, until):
    """Watch the first sockets of all pairs and run until `until` reads; return the pairs' numbers and the data."""
    numbers = []
    for number, (ours, _) in enumerate(pairs):
        engine.watch(ours.fileno(), lambda number=number, ours=ours: numbers.append((number, ours.recv(100))))
    engine.call_at(engine.now() + 5, lambda: numbers.extend([None] * until))
    engine.run(lambda: len(numbers) >= until)
    return numbers


def test_callback_of_a_readable_socket_is_called(engine, pairs):
    pairs[2][1].send(b"two")
    pairs[0][1].send(b"none")
    assert sorted(heard(engine, pairs, 2)) == [(0, b"none"), (2, b"two")]


def test_callback_of_an_unwatched_socket_is_not_called(engine, pairs):
    for _, theirs in pairs:
        theirs.send(b"x")
    called = []

    def first(number):
        called.append(number)
        for other in {0, 1, 2} - {number}:
            engine.unwatch(pairs[other][0].fileno())
        engine.unwatch(pairs[number][0].fileno())

    for number, (ours, _) in enumerate(pairs):
        engine.watch(ours.fileno(), lambda number=number: first(number))
    engine.run(lambda: bool(called))
    assert len(called) == 1


def test_closed_descriptor_can_still_be_unwatched(engine, pairs):
    ours, theirs = pairs[0]
    number = ours.fileno()
    engine.watch(number, lambda: None)
    ours.close()
    engine.unwatch(number)
    theirs.close()
    again = socket.socketpair()
    engine.watch(again[0].fileno(), lambda: None)
    engine.unwatch(again[0].fileno())
    for each in again:
        each.close()
