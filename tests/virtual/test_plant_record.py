"""A capture of a whole virtual plant, and its behaviour on a full disk."""

import errno
import logging

import pytest

import drivecomm
from drivecomm.capture import GrowingFile, read_capture
from drivecomm.errors import FileFormatError
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import PlantRecord, VirtualPlant


@pytest.fixture
def plant():
    return VirtualPlant(
        Plant(
            lines=(PlantLine(name="hall"), PlantLine(name="yard")),
            drives=(
                DriveConfig(name="pump", protocol="vabus", address=1, line="hall"),
                DriveConfig(name="fan", protocol="danfoss-fc", address=3, line="yard"),
            ),
        )
    )


def read(plant):
    with drivecomm.open_bus(plant.line("hall").port) as hall, drivecomm.open_bus(plant.line("yard").port) as yard:
        pump = hall.drive("vabus", 1, model="agile").read("481")
        yard.drive("danfoss-fc", 3, model="fc300").read("16-14")
    plant.line("hall").inject(b"\x55")
    for line in plant.lines.values():
        line.advance(1)
    return pump


@pytest.mark.parametrize("suffix", ["jsonl", "pcapng"])
def test_record_of_several_lines_names_line_sender_and_settings(plant, tmp_path, suffix):
    with PlantRecord(plant, tmp_path / f"rec.{suffix}"):
        read(plant)
    capture = read_capture(tmp_path / f"rec.{suffix}")
    assert capture.provenance.drives == ("danfoss-fc:3", "vabus:1")
    heard = {(each.line, each.source, str(each.settings)) for each in capture.pieces}
    assert heard == {
        ("hall", "master", "19200 7E1"),
        ("hall", "drive", "19200 7E1"),
        ("hall", "unknown", "19200 7E1"),
        ("yard", "master", "9600 8E1"),
        ("yard", "drive", "9600 8E1"),
    }


def test_full_disk_is_logged_and_does_not_end_the_serving(plant, tmp_path, monkeypatch, caplog):
    add, added = GrowingFile.add, []

    def add_until_full(file, piece):
        added.append(piece)
        if len(added) > 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        add(file, piece)

    monkeypatch.setattr(GrowingFile, "add", add_until_full)
    with caplog.at_level(logging.WARNING, "drivecomm.capture"), PlantRecord(plant, tmp_path / "rec.jsonl"):
        assert str(read(plant)) == "10.00 Hz"
    assert len(read_capture(tmp_path / "rec.jsonl").pieces) == 2
    begin, end = caplog.messages
    assert "no space left on the device; pieces are not recorded from" in begin
    assert "serving continues" in begin
    assert "is incomplete" in end


def test_record_in_an_unknown_format_is_refused_before_recording(plant, tmp_path):
    with pytest.raises(FileFormatError, match="is not a capture file"), PlantRecord(plant, tmp_path / "rec.txt"):
        pass
    assert not plant.line("hall").recorders
