"""Full disks: neither polling nor a recording ends, and no partial data are left."""

import errno
import logging
import subprocess
import sys
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import pytest
from test_value_log import result

import drivecomm
from drivecomm.capture import TRIED_AGAIN_S, CaptureWriter, GrowingFile, Piece, Provenance, WriteGaps, read_capture
from drivecomm.cli import main
from drivecomm.plant.value_log import open_log, read_rows
from drivecomm.protocol import LineSettings
from drivecomm.virtual import VirtualLine, virtual_drive

resource = pytest.importorskip("resource", reason="file sizes are limited on POSIX only")


@contextmanager
def room_for(size):
    """Limit the size of every file of this process within the block."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def clock(time_s):
    return datetime.fromtimestamp(time_s).astimezone().strftime("%H:%M:%S")


def test_piece_is_written_completely_or_not_at_all(tmp_path):
    path = tmp_path / "pieces"
    path.write_bytes(b"head and half a pie")
    file = GrowingFile(path, keep=5)
    with room_for(20):
        file.add(b"first piece")
        with pytest.raises(OSError, match="File too large"):
            file.add(b"second piece")
        assert path.read_bytes() == b"head first piece"
        file.add(b"4444")
        with pytest.raises(OSError, match="File too large"):
            file.add(b"x")
    file.add(b" and the last")
    file.close()
    assert path.read_bytes() == b"head first piece4444 and the last"


def test_partial_piece_is_removed_before_the_next_piece(tmp_path):
    path = tmp_path / "pieces"
    file = GrowingFile(path)
    file.add(b"one ")

    class Failing:
        """File on a device that fails in the middle of a piece and from then on."""

        def __init__(self, inner):
            self.inner, self.dead = inner, False

        def write(self, data):
            if self.dead:
                raise OSError(errno.EIO, "Input/output error")
            self.dead = True
            return self.inner.write(data[:2])

        def truncate(self, size):
            if self.dead:
                raise OSError(errno.EIO, "Input/output error")
            return self.inner.truncate(size)

        def __getattr__(self, name):
            return getattr(self.inner, name)

    sound, failing = file._file, Failing(file._file)
    file._file = failing
    for _ in range(2):
        with pytest.raises(OSError, match="Input/output"):
            file.add(b"two ")
    assert path.read_bytes() == b"one tw"
    file._file = sound
    file.add(b"three")
    file.close()
    assert path.read_bytes() == b"one three"


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (errno.ENOSPC, "no space left on the device"),
        (errno.EFBIG, "the file may not grow any further"),
        (errno.EIO, "the device cannot be written"),
        (errno.EROFS, "words of the system"),
    ],
)
def test_start_and_end_of_a_gap_are_reported_once(number, reason):
    told, written, full = [], [], [True]
    gaps = WriteGaps("x.csv", kept="values", done="logged", goes_on="polling", tell=told.append)

    def write():
        if full[0]:
            raise OSError(number, "words of the system")
        written.append(now)

    start = 1_790_000_000.0
    for now in (start, start + 1, start + TRIED_AGAIN_S):
        assert not gaps.write(write, now)
    assert told == [f"x.csv: {reason}; values are not logged from {clock(start)} on; polling continues"]
    full[0] = False
    assert not gaps.write(write, now + 1), "it is not tried each time"
    assert gaps.write(write, now + TRIED_AGAIN_S)
    assert told[1:] == [f"x.csv: values are logged again from {clock(now + TRIED_AGAIN_S)} on; 4 are missing"]
    assert gaps.write(write, now + TRIED_AGAIN_S)
    assert len(told) == len(written) == 2
    assert gaps.summary == "x.csv: is incomplete; 4 values are missing"


def test_clock_set_back_does_not_prevent_a_retry():
    gaps = WriteGaps("x", kept="values", done="logged", goes_on="polling", tell=lambda _: None)
    full = [True]

    def write():
        if full[0]:
            raise OSError(errno.ENOSPC, "full")

    assert not gaps.write(write, 1_790_000_000.0)
    full[0] = False
    assert gaps.write(write, 1_780_000_000.0)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_log_loses_only_the_rows_without_room(tmp_path, ending, caplog):
    path = tmp_path / f"log.{ending}"
    with open_log(path) as log:
        with room_for(2000), caplog.at_level(logging.WARNING):
            for number in range(100):
                log.write(result(number, time_s=number))
        for number in range(100, 110):
            log.write(result(number, time_s=number))
    numbers = [row.number for row in read_rows(path)]
    assert len(numbers) == log.written == 110 - log.missing
    gap = next(place for place, number in enumerate(numbers) if number != place)
    assert numbers[gap:] == [float(number) for number in range(gap + log.missing, 110)]
    begin, end = (record.getMessage() for record in caplog.records)
    assert "log" in begin
    assert "the file may not grow any further; values are not logged from" in begin
    assert end.endswith(f"{log.missing} are missing")


@pytest.mark.parametrize("suffix", [".jsonl", ".pcapng"])
def test_recording_continues_when_there_is_room_again(tmp_path, suffix, caplog):
    path = tmp_path / f"a{suffix}"
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 2)])
    with caplog.at_level(logging.WARNING), drivecomm.open_bus(line.port, record=path) as bus:
        pump, fan = bus.drive("vabus", 1), bus.drive("danfoss-fc", 2)
        with room_for(700):
            for _ in range(10):
                pump.read("481")
            fan.read("16-30")
        bus.sleep_until(bus.now() + TRIED_AGAIN_S)
        fan.read("16-30")
        pump.read("481")
    begin, end = (record.getMessage() for record in caplog.records)
    assert "pieces are not recorded from" in begin
    assert "pieces are recorded again from" in end
    capture = read_capture(path)
    assert not capture.remarks
    assert {piece.settings for piece in capture.pieces if piece.time_s < TRIED_AGAIN_S} == {None}
    assert {piece.settings for piece in capture.pieces if piece.time_s > TRIED_AGAIN_S} == {None, fan.facts.settings}


@pytest.mark.parametrize("suffix", [".jsonl", ".pcapng"])
def test_piece_without_room_can_be_added_later_with_its_settings(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    pieces = [Piece(time_s=number, data=b"abc", settings=LineSettings(baudrate=9600 << number)) for number in range(2)]
    with CaptureWriter(path, Provenance()) as writer:
        writer.add(pieces[0])
        with room_for(path.stat().st_size + 40), pytest.raises(drivecomm.FileFormatError, match="cannot be written"):
            writer.add(pieces[1])
        assert read_capture(path).pieces == pieces[:1]
        writer.add(pieces[1])
    capture = read_capture(path)
    assert capture.pieces == pieces
    assert not capture.remarks


COMMAND = """
import resource, sys
import drivecomm.bus.opening, drivecomm.cli.poll
from drivecomm.virtual import VirtualLine, virtual_drive
line = VirtualLine([virtual_drive("vabus", 1)])
drivecomm.bus.opening.port_opener = lambda port, **_: line.port
said, show = [], drivecomm.cli.poll._Rows.say
def say(rows, result):
    said.append(result)
    if len(said) == 40:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    if len(said) == 60 and "interrupt" in sys.argv:
        raise KeyboardInterrupt
drivecomm.cli.poll._Rows.say = say
resource.setrlimit(resource.RLIMIT_FSIZE, (1500, resource.RLIM_INFINITY))
from drivecomm.cli import main
sys.exit(main(["poll", "vabus:1,model=agile", "481", "--for", "61", "--port", "line", sys.argv[1], sys.argv[2]]))
"""


@pytest.mark.soak
@pytest.mark.parametrize("how", ["ends", "interrupt"])
@pytest.mark.parametrize(("option", "ending"), [("--log", "csv"), ("--log", "parquet"), ("--record", "jsonl")])
def test_poll_continues_and_its_exit_code_reports_missing_rows(tmp_path, option, ending, how):
    path = tmp_path / f"x.{ending}"
    command = [sys.executable, "-c", COMMAND, option, str(path), how]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == (130 if option == "--record" and how == "interrupt" else 1), done.stderr
    assert "Traceback" not in done.stderr
    begin, end, *rest = done.stderr.splitlines()
    assert begin.startswith(f"drivecomm: {path}")
    assert begin.endswith("continues")
    assert "again from" in end
    if how == "interrupt" and option == "--record":
        assert rest == ["drivecomm: interrupted"]
    else:
        assert "is incomplete" in rest[0]
    if option == "--log":
        rows = list(read_rows(path))
        assert 25 < len(rows) < 60
        assert rows[0].time.timestamp() < 1
        assert rows[-1].time.timestamp() >= 58
    else:
        assert not read_capture(path).remarks


def test_unfinished_parquet_log_names_the_file_with_its_rows(tmp_path):
    path = tmp_path / "log.parquet"
    log = open_log(path)
    for number in range(12):
        log.write(result(number, time_s=number))
    with room_for(1500), pytest.raises(drivecomm.FileFormatError) as raised:
        log.close()
    assert "the rows are in" in str(raised.value)
    assert [each.name for each in tmp_path.iterdir()] == ["log.parquet.csv"]
    assert list(read_rows(path)), "what is there is read by the log's name"


def test_full_device_is_refused_before_a_port_is_opened(tmp_path, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    path = tmp_path / "log.csv"
    path.symlink_to("/dev/full")
    assert main(["poll", "vabus:1", "481", "--port", str(tmp_path / "no-port"), "--log", str(path)]) == 2
    assert capsys.readouterr().err == f"drivecomm: {path}: cannot be written as a log: No space left on device\n"
