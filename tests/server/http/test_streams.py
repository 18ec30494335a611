"""Streams of values and events: to clients that read, to clients that do not, and to a thousand clients."""

import asyncio
import socket
import threading
import time
from dataclasses import replace

import pytest
from fake_plant import Client, EventSource, FakePlant, served, value

from drivecomm.server.http import HttpDoor, LocalDoor, stream as streams
from drivecomm.tomlfile import TomlTable

ASK = b"GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n"


def drives_of(message):
    return {each["drive"] for each in message.data}


def test_stream_begins_with_all_known_values(local):
    with local.stream() as stream:
        assert stream.next().name == "hello"
        assert drives_of(stream.next()) == {"pump", "fan"}


def test_nan_in_a_value_does_not_affect_other_values(local, plant):
    with local.stream() as stream, local.stream("?every=0.1") as slow:
        stream.next("values"), slow.next("values")
        plant.change(replace(value("pump"), time_s=float("nan")), value("fan", amount="7"))
        for each in (stream, slow):
            told = {each["drive"]: each for each in each.next("values").data}
            assert (told["pump"]["quality"], told["pump"]["reading"]) == ("bad", None)
            assert "cannot be told" in told["pump"]["cause"]
            assert told["fan"]["reading"]["value"] == 7
        plant.change(value("pump", amount="8"))
        assert stream.next("values").data[0]["reading"]["value"] == 8
    assert local.get("/api/v1/values").status == 200


@pytest.mark.parametrize("query", ["", "?every=0.1"])
def test_stream_works_again_after_an_internal_error(local, plant, monkeypatch, query):
    right, mistakes = streams.value_head, [RuntimeError("a mistake")]

    def head(told):
        if told.name == "odd" and mistakes:
            raise mistakes.pop()
        return right(told)

    monkeypatch.setattr(streams, "value_head", head)
    with local.stream(query) as stream, local.stream("?drives=fan") as another:
        stream.next("values"), another.next("values")
        plant.change(value("pump", "odd"))
        # The affected client is disconnected, so that it connects again.
        with pytest.raises((EOFError, OSError)):
            stream.next("values")
    with local.stream(query) as stream:
        stream.next("values")
        plant.change(value("pump", amount="8"))
        assert stream.next("values").data[0]["reading"]["value"] == 8


def test_stream_is_limited_to_the_requested_drives(local, plant):
    with local.stream("?drives=fan") as stream:
        assert drives_of(stream.next("values")) == {"fan"}
        plant.change(value("pump"), events=[plant.event(1, drive="pump")])
        plant.change(value("fan", amount="5"), events=[plant.event(2, drive="fan"), plant.event(3, drive="")])
        told = [stream.next(), stream.next()]
        assert {each.name for each in told} == {"values", "events"}
        for each in told:
            assert "pump" not in drives_of(each)


def test_stream_of_an_unknown_drive_gives_404(local):
    found = local.get("/api/v1/stream?drives=pump,fax")
    assert found.status == 404
    assert "did you mean 'fan'?" in found.content["error"]["text"]


@pytest.mark.soak
def test_stream_interval_sends_only_the_latest_values(local, plant):
    with local.stream("?every=0.3") as stream:
        stream.next("values")
        began = time.monotonic()
        for amount in range(50):
            plant.change(value("pump", amount=str(amount)))
            time.sleep(0.005)
        messages = []
        while not messages or messages[-1].data[-1]["reading"]["value"] != 49:
            messages.append(stream.next("values"))
        assert len(messages) <= (time.monotonic() - began) / 0.3 + 1
        assert all(len(each.data) == 1 for each in messages)


def test_events_are_streamed_without_waiting_for_the_interval(local, plant):
    with local.stream("?every=60") as stream:
        stream.next("values")
        plant.change(value("pump"), events=[plant.event(1)])
        assert stream.next().name == "events"


def test_two_streams_with_equal_options_get_every_value(local, plant):
    with local.stream() as first, local.stream() as second:
        first.next("values"), second.next("values")
        for amount in ("1", "2", "3"):
            plant.change(value("pump", amount=amount))
            assert str(first.next().data[0]["reading"]["value"]) == amount
            assert str(second.next().data[0]["reading"]["value"]) == amount


def test_last_event_id_gives_the_missed_events(local, plant):
    plant.change(events=[plant.event(number) for number in range(1, 6)])
    with local.stream("", **{"Last-Event-ID": "3"}) as stream:
        assert [each["number"] for each in stream.next("events").data] == [4, 5]
    with local.stream() as stream:
        stream.next("values")
        plant.change(events=[plant.event(6)])
        assert [each["number"] for each in stream.next("events").data] == [6]


def test_last_event_id_of_an_earlier_run_hides_no_event(local, plant):
    with local.stream("", **{"Last-Event-ID": "1000"}) as stream:
        stream.next("values")
        plant.change(events=[plant.event(1)])
        assert stream.next("events").data[0]["number"] == 1


@pytest.mark.soak
def test_slow_reader_gets_latest_values_and_the_number_of_lost_events(plant, door):
    with socket.create_connection(("127.0.0.1", door.port)) as slow, Client(door, "annaanna").stream() as quick:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.settimeout(20)
        slow.sendall(ASK.replace(b"\r\n\r\n", b"\r\nAuthorization: Bearer annaanna\r\n\r\n"))
        quick.next("values")
        source = EventSource(slow)
        source.next("values")
        text = "x" * 1000
        for number in range(1, 3001):
            plant.change(value("pump", amount=str(number)), events=[plant.event(number, text)])
            if not number % 25:
                # The fast reader receives every event.
                while quick.next("events").data[-1]["number"] != number:
                    pass
        numbers, lost, amounts = [], 0, []
        while not amounts or amounts[-1] != 3000 or numbers[-1] != 3000:
            message = source.next()
            if message.name == "events":
                numbers += [each["number"] for each in message.data]
            elif message.name == "lost":
                lost += message.data["events"]
            elif message.name == "values":
                amounts += [int(each["reading"]["value"]) for each in message.data if each["drive"] == "pump"]
        assert lost > 1000
        assert len(numbers) + lost == 3000
        assert numbers == sorted(set(numbers))
        assert amounts == sorted(amounts)
        assert len(amounts) < 2000
        source.close()


@pytest.mark.soak
def test_client_that_never_reads_is_disconnected(plant, door, monkeypatch):
    monkeypatch.setattr(streams, "NOT_READING_S", 0.3)
    with socket.create_connection(("127.0.0.1", door.port)) as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.sendall(ASK.replace(b"\r\n\r\n", b"\r\nAuthorization: Bearer annaanna\r\n\r\n"))
        until = time.monotonic() + 20
        while not plant.listeners:
            time.sleep(0.01)
        number = 0
        while plant.listeners and time.monotonic() < until:
            number += 1
            plant.change(events=[plant.event(number, "x" * 2000)])
            time.sleep(0.001)
        assert not plant.listeners, "the client is still connected"


def test_plant_subscription_ends_with_the_last_stream(local, plant):
    with local.stream() as stream:
        stream.next("values")
        assert len(plant.listeners) == 1
    until = time.monotonic() + 5
    while plant.listeners and time.monotonic() < until:
        time.sleep(0.01)
    assert not plant.listeners


def test_stream_sends_pings(plant, tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "PING_S", 0.05)
    with served(LocalDoor(tmp_path / "x.sock"), plant), Client(tmp_path / "x.sock").stream() as stream:
        stream.next("values")
        while b": ping" not in stream.line():
            pass


def test_stream_omits_a_removed_drive(plant, tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "PING_S", 0.05)
    with served(LocalDoor(tmp_path / "x.sock"), plant), Client(tmp_path / "x.sock").stream() as first:
        first.next("values")
        whole = plant.plant
        plant.plant = replace(whole, drives=[each for each in whole.drives if each.name != "fan"])
        plant.current = {key: each for key, each in plant.current.items() if key[0] != "fan"}
        for _ in range(2):
            while b": ping" not in first.line():
                pass
        with Client(tmp_path / "x.sock").stream() as second:
            assert drives_of(second.next("values")) == {"pump"}


def test_stream_is_refused_for_http_1_0(local):
    with local.connect() as connected:
        connected.sendall(b"GET /api/v1/stream HTTP/1.0\r\nHost: localhost\r\n\r\n")
        assert b" 505 " in connected.recv(1000).splitlines()[0]


def test_door_with_open_streams_closes_quickly(plant, tmp_path):
    path = tmp_path / "x.sock"
    with served(LocalDoor(path), plant) as running, Client(path).stream() as stream:
        stream.next("values")
        with Client(path).connect() as idle:
            idle.sendall(b"GET /api/v1/pl")
            running.end()
        assert running.ended_s < 2
        with pytest.raises(EOFError):
            stream.next()
    assert not path.exists()


@pytest.mark.soak
@pytest.mark.parametrize("crowd", [100, pytest.param(1000, marks=pytest.mark.soak)])
def test_many_streams_block_the_event_loop_for_milliseconds_only(crowd):
    """A tenth of the clients never reads; requests still work, and no step blocks the event loop for long."""
    polled = ("output_frequency", "output_current", "dc_link_voltage", "torque")
    plant = FakePlant([f"drive-{number}" for number in range(100)], polled=polled)
    door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
    told = threading.Event()
    with served(door, plant) as running:
        reading = threading.Thread(target=lambda: asyncio.run(_crowd(door.port, crowd, told)))
        reading.start()
        held = []

        async def watch():
            # Thread time does not depend on the load of other processes.
            while True:
                before = time.thread_time()
                await asyncio.sleep(0.001)
                held.append(time.thread_time() - before)

        assert told.wait(60)
        running.loop.call_soon_threadsafe(lambda: setattr(running, "watching", running.loop.create_task(watch())))
        names = list(plant.states)
        for number in range(200):
            plant.change(*(value(name, "torque", str(number)) for name in names[:10]), events=[plant.event(number + 1)])
            time.sleep(0.005)
        running.loop.call_soon_threadsafe(running.watching.cancel)
        held.sort()
        assert held[int(len(held) * 0.95)] < 0.02, f"{held[-1] * 1e3:.1f} ms"
        assert Client(door).get("/api/v1/plant").status == 200
    reading.join(20)
    assert running.ended_s < 3


async def _crowd(port, many, told):
    async def come():
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**22)
        writer.write(ASK)
        await reader.readuntil(b"event: hello")
        return reader, writer

    async def read(reader):
        while await reader.read(2**16):
            pass

    there = []
    while len(there) < many:
        there += await asyncio.gather(*(come() for _ in range(20)))
    for _, writer in there[::10]:
        writer.transport.pause_reading()
    told.set()
    await asyncio.gather(*(read(each) for number, (each, _) in enumerate(there) if number % 10), return_exceptions=True)
    for _, writer in there:
        writer.transport.abort()
    await asyncio.sleep(0.1)
