"""Recordings of a bus: every byte sent and received, whatever happens to the line, and no cost when off."""

import asyncio
import logging
from contextlib import suppress

import pytest

import drivecomm
from drivecomm import bus as buses
from drivecomm.capture import Provenance, RecordedPort, Recording, read_capture
from drivecomm.errors import LinkDownError, NoReplyError, PortError, UsageError
from drivecomm.plant import FaultPlan
from drivecomm.protocol import LineSettings
from drivecomm.version import __version__
from drivecomm.virtual import VirtualLine, virtual_drive

READS = {"vabus": "481", "danfoss-fc": "16-30", "vlt3500": "215", "fuji": "M21"}
VABUS = LineSettings(baudrate=19200, bytesize=7, parity="E")


class Pieces(list):
    def add(self, piece):
        self.append(piece)

    def said_by(self, source):
        return b"".join(piece.data for piece in self if piece.source == source)


class Wire(Pieces):
    """Bytes on the wire of a virtual line, as the line itself reports them."""

    def __init__(self, line):
        super().__init__()
        self.sent, self.heard = [], []
        line.monitors.append(lambda sent: (self.sent if sent.source == "master" else self.heard).append(sent))


def everybody():
    return VirtualLine([virtual_drive(name, number) for number, name in enumerate(READS, start=1)])


def read_all(bus):
    return [bus.drive(name, number).read(READS[name]).raw for number, name in enumerate(READS, start=1)]


def test_every_byte_is_recorded():
    line, pieces = everybody(), Pieces()
    wire = Wire(line)
    with drivecomm.open_bus(line.port, record=pieces) as bus:
        read_all(bus)
        bus.drive("danfoss-fc", 2).write("3-41", 1000, type="uint32")
        with pytest.raises(NoReplyError):
            bus.drive("vabus", 9, attempts=2).read("481")
    sent = [piece for piece in pieces if piece.source == "master"]
    assert [piece.data for piece in sent] == [each.data for each in wire.sent]
    assert [piece.time_s for piece in sent] == pytest.approx([each.ended for each in wire.sent])
    assert pieces.said_by("drive") == b"".join(each.data for each in wire.heard)
    assert [piece.time_s for piece in pieces] == sorted(piece.time_s for piece in pieces)
    assert {piece.source for piece in pieces} == {"master", "drive"}


def test_recording_does_not_change_the_traffic():
    def seen(**options):
        line, events = everybody(), []
        with drivecomm.open_bus(line.port, trace=events.append, **options) as bus:
            return read_all(bus), events, line.time

    assert seen() == seen(record=Pieces())


def test_line_settings_are_recorded(tmp_path):
    settings = [VABUS, LineSettings(baudrate=9600, parity="E"), LineSettings(baudrate=9600)]
    pieces, path = Pieces(), tmp_path / "a.jsonl"
    with drivecomm.open_bus(everybody().port, record=pieces) as bus:
        read_all(bus)
    assert list(dict.fromkeys(piece.settings for piece in pieces)) == settings
    with drivecomm.open_bus(everybody().port, record=path) as bus:
        read_all(bus)
    found = read_capture(path)
    assert found.provenance.settings == VABUS
    assert list(dict.fromkeys(piece.settings for piece in found.pieces)) == [None, *settings[1:]]


@pytest.mark.parametrize("suffix", [".jsonl", ".pcapng"])
def test_recording_holds_its_provenance(tmp_path, suffix):
    line, pieces, path = everybody(), Pieces(), tmp_path / f"all{suffix}"
    with drivecomm.open_bus(line.port, record=path) as bus:
        known = bus.drive("fuji", 4)
        bus.drive("vabus", 1).read("481")
    assert known.name == "fuji:4"
    line = everybody()
    with drivecomm.open_bus(line.port, record=pieces) as bus:
        bus.drive("vabus", 1).read("481")
    found = read_capture(str(path))
    assert found.provenance == Provenance(tool=f"drivecomm {__version__}", settings=VABUS, drives=("fuji:4", "vabus:1"))
    rounded = [(round(piece.time_s, 9), piece.data, piece.source) for piece in pieces]
    assert [(piece.time_s, piece.data, piece.source) for piece in found.pieces] == rounded


def test_recording_is_readable_before_the_bus_is_closed(tmp_path):
    path = tmp_path / "a.jsonl"
    with drivecomm.open_bus(everybody().port, record=str(path)) as bus:
        bus.drive("vabus", 1).read("481")
        assert read_capture(path).pieces


def test_recording_of_a_line_without_traffic_is_empty(tmp_path):
    path = tmp_path / "a.jsonl"
    with drivecomm.open_bus(everybody().port, record=path):
        assert not path.exists()
    assert read_capture(path).pieces == []


def test_damaged_and_noisy_traffic_is_recorded():
    line, pieces = everybody(), Pieces()
    line.faults = FaultPlan(seed=3, rate=0.5)
    wire = Wire(line)
    with drivecomm.open_bus(line.port, record=pieces, attempts=2) as bus:
        drive = bus.drive("vabus", 1)
        for _ in range(30):
            try:
                drive.read("481")
            except drivecomm.DriveCommError:
                continue
        counted = bus.counters["vabus:1"]
    assert counted["retries"]
    assert len([piece for piece in pieces if piece.source == "master"]) >= 30
    assert pieces.said_by("drive")
    assert len(pieces.said_by("drive")) <= sum(len(each.data) for each in wire.heard)


def test_recording_continues_after_a_lost_port():
    line, pieces = everybody(), Pieces()
    with drivecomm.open_bus(line.port, record=pieces) as bus:
        drive = bus.drive("vabus", 1)
        drive.read("481")
        before = len(pieces)
        line.broken = True
        with pytest.raises(LinkDownError):
            drive.read("481")
        line.broken = False
        line.advance(5)
        drive.read("481")
    assert len(pieces) > before
    assert pieces[before].data == pieces[0].data
    assert pieces[before].time_s > 5


@pytest.mark.parametrize("echo", ["expect", "auto"])
def test_echo_is_not_recorded(echo):
    line, pieces = VirtualLine([virtual_drive("vabus", 1)], echo=True), Pieces()
    wire = Wire(line)
    with drivecomm.open_bus(line.port, record=pieces, echo=echo) as bus:
        for _ in range(3):
            bus.drive("vabus", 1).read("481")
        line.advance(1)
    assert pieces.said_by("master") == b"".join(each.data for each in wire.sent)
    # The last telegram closes the exchange, and its echo has not arrived yet.
    assert pieces.said_by("drive") == b"".join(each.data for each in wire.heard)


@pytest.mark.parametrize("echo", ["auto", "expect"])
def test_missing_echo_loses_no_byte(echo):
    line, pieces = VirtualLine([virtual_drive("danfoss-fc", 3)]), Pieces()
    wire = Wire(line)
    with drivecomm.open_bus(line.port, record=pieces, echo=echo) as bus:
        for _ in range(3):
            # If an echo is expected, bytes in its place do not count as a reply.
            with suppress(NoReplyError):
                bus.drive("danfoss-fc", 3).read("16-30")
    assert wire.heard
    assert pieces.said_by("drive") == b"".join(each.data for each in wire.heard)


def test_bytes_that_only_begin_like_an_echo_are_recorded():
    class Scripted:
        paced = real_time = False
        descriptor = None
        time = 0.0
        replies = iter([b"ab", b"abc", b"a"])
        wall_time = hold_back = wait = close = write = lambda *_: None

        def now(self):
            return self.time

        def take(self):
            self.time += 1
            return next(self.replies)

    pieces = Pieces()
    recording = Recording(Scripted, pieces, echo="auto")
    port = recording.open_port()
    for _ in range(3):
        port.write(b"abc")
        port.take()
    recording.close()
    assert [(piece.time_s, piece.source, piece.data) for piece in pieces] == [
        (0, "master", b"abc"),
        (1, "drive", b"ab"),
        (1, "master", b"abc"),
        (2, "master", b"abc"),
        (3, "drive", b"a"),
    ]


def test_awaited_buses_record_the_same():
    async def awaited(pieces):
        async with drivecomm.open_bus_async(everybody().port, record=pieces) as bus:
            for number, name in enumerate(READS, start=1):
                await bus.drive(name, number).read(READS[name])

    theirs, ours = Pieces(), Pieces()
    asyncio.run(awaited(theirs))
    with drivecomm.open_bus(everybody().port, record=ours) as bus:
        read_all(bus)
    assert theirs == ours


def test_awaited_buses_close_their_file(tmp_path):
    async def awaited(path):
        async with drivecomm.open_bus_async(everybody().port, record=path) as bus:
            await bus.drive("vabus", 1).read("481")

    path = tmp_path / "a.pcapng"
    asyncio.run(awaited(path))
    assert read_capture(path).pieces


def test_failed_recorder_does_not_disturb_the_bus(caplog):
    class Full(Pieces):
        def add(self, piece):
            if len(self) == 2:
                raise OSError("no space left")
            super().add(piece)

    pieces = Full()
    with caplog.at_level(logging.WARNING), drivecomm.open_bus(everybody().port, record=pieces) as bus:
        bus.drive("vabus", 1).read("481")
        bus.drive("danfoss-fc", 2).stop()
    assert len(pieces) == 2
    assert [record.getMessage() for record in caplog.records] == [
        "the recording has stopped, the line continues: no space left"
    ]


@pytest.mark.parametrize("place", ["a.txt", "nowhere/a.jsonl"])
def test_unusable_file_is_refused_before_anything_is_sent(tmp_path, place):
    line = everybody()
    wire = Wire(line)
    with pytest.raises(UsageError):
        drivecomm.open_bus(line.port, record=tmp_path / place)
    assert not wire.sent


def test_unopened_port_creates_and_replaces_no_file(tmp_path):
    path = tmp_path / "a.jsonl"
    with pytest.raises(PortError):
        drivecomm.open_bus(str(tmp_path / "no-port"), record=path)
    assert not path.exists()
    path.write_text("precious")
    with pytest.raises(PortError):
        drivecomm.open_bus(str(tmp_path / "no-port"), record=path)
    assert path.read_text() == "precious"


def test_bus_without_recording_uses_the_bare_port(monkeypatch):
    made = []
    monkeypatch.setattr(RecordedPort, "__init__", lambda *_: made.append(1))
    line = everybody()
    with drivecomm.open_bus(line.port) as bus:
        read_all(bus)
        assert bus.line.port.__class__ is line.port().__class__
    assert not made
    assert buses.Bus(line.port, bus._roster).line._on_close is None
