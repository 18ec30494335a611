"""Recordings of real ports: every byte that passed, blocking and awaited."""

import asyncio
import os
from contextlib import contextmanager

import pytest
from serving_threads import served_in_thread
from sessions import ADDRESSES, READS, Recorded, read_everybody

import drivecomm
from drivecomm.capture import read_capture
from drivecomm.errors import LinkDownError, NoReplyError
from drivecomm.traffic.replay import recorded_drives, replayed
from drivecomm.virtual import Server, parse_listen, virtual_drive

KINDS = ["tcp", *(["pty"] if os.name == "posix" else [])]


class LineSample:
    """Listener that keeps all bytes passing through it."""

    def __init__(self, listener):
        self._listener = listener
        self.sent, self.heard = b"", b""
        self.open, self.close = listener.open, listener.close

    @property
    def address(self):
        return self._listener.address

    @property
    def settings(self):
        return self._listener.settings

    @property
    def descriptor(self):
        return self._listener.descriptor

    def receive(self, wait_s):
        data = self._listener.receive(wait_s)
        self.sent += data
        return data

    def send(self, data):
        self.heard += data
        self._listener.send(data)


@contextmanager
def serving(kind, tmp_path, drives, **options):
    listener = LineSample(parse_listen(f"pty:{tmp_path / 'line'}" if kind == "pty" else "tcp:127.0.0.1:0"))
    with served_in_thread(Server(drives, listener, **options)):
        yield listener


def everybody():
    return [virtual_drive(name, address) for name, address in ADDRESSES.items()]


async def read_everybody_awaited(address, record):
    async with drivecomm.open_bus_async(address, record=record) as bus:
        for _ in range(3):
            for name, number in ADDRESSES.items():
                await bus.drive(name, number).read(READS[name])


def said_by(pieces, source):
    return b"".join(piece.data for piece in pieces if piece.source == source)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", ["blocking", "awaited"])
def test_every_byte_is_recorded(kind, way, tmp_path):
    path = tmp_path / "a.jsonl"
    with serving(kind, tmp_path, everybody()) as overheard:
        if way == "awaited":
            asyncio.run(read_everybody_awaited(overheard.address, path))
        else:
            with drivecomm.open_bus(overheard.address, record=path) as bus:
                for _ in range(3):
                    read_everybody(bus)
    capture = read_capture(path)
    # The last VABus telegram has no reply, and may not have arrived when the line was closed.
    assert said_by(capture.pieces, "master").startswith(overheard.sent)
    assert said_by(capture.pieces, "drive") == overheard.heard
    assert capture.provenance.port == overheard.address
    assert capture.provenance.began is not None
    times = [piece.time_s for piece in capture.pieces]
    assert times == sorted(times)
    assert times[-1] < 20


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_recording_of_a_real_port_replays_in_tests(kind, tmp_path):
    """A recording made in real time replays in virtual time, and its drives answer again in real time."""
    path = tmp_path / "a.pcapng"
    with serving(kind, tmp_path, everybody()) as overheard, drivecomm.open_bus(overheard.address, record=path) as bus:
        values = read_everybody(bus)
    with replayed(path) as line, drivecomm.open_bus(line.port) as bus:
        assert read_everybody(bus) == values
    with (
        serving(kind, tmp_path, recorded_drives(read_capture(path))) as overheard,
        drivecomm.open_bus(overheard.address, attempts=1) as bus,
    ):
        assert read_everybody(bus) == values
        drive = bus.drive("vabus", 1)
        with pytest.raises(NoReplyError):
            drive.read("482")


def test_recording_continues_after_the_server_was_away(tmp_path):
    pieces = Recorded()
    with serving("tcp", tmp_path, everybody()) as overheard:
        place = overheard.address.rpartition(":")[2]
        bus = drivecomm.open_bus(overheard.address, record=pieces)
        drive = bus.drive("danfoss-fc", 3, attempts=1, reply_timeout_s=0.2)
        drive.read("16-30")
    before = len(pieces)
    with pytest.raises((LinkDownError, NoReplyError)):
        drive.read("16-30")
    listener = parse_listen(f"tcp:127.0.0.1:{place}")
    with served_in_thread(Server(everybody(), listener)), bus:
        for _ in range(100):
            try:
                drive.read("16-30")
                break
            except drivecomm.DriveCommError:
                bus.sleep_until(bus.now() + 0.05)
    again = pieces[before:]
    assert said_by(again, "drive")
    assert again[-1].time_s > pieces[before - 1].time_s
