"""Value logs: rows are read back as written, despite cut-off files, killed programs and foreign files."""

import csv
import subprocess
import sys
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import pyarrow as pa
import pytest
from hypothesis import given, settings, strategies as st
from pyarrow import parquet

from drivecomm.errors import FileFormatError, NoReplyError, UsageError
from drivecomm.line import PollItem, PollResult
from drivecomm.plant.value_log import (
    COLUMNS,
    CsvLog,
    LogRow,
    ParquetLog,
    journal_of,
    open_log,
    read_csv,
    read_parquet,
    read_rows,
    row_of,
)
from drivecomm.protocol import Reading

TIME = 1_790_000_000.125


def result(value=Decimal("10.00"), *, time_s=TIME, error=None, name="output_frequency", **reading):
    read = None
    if value is not None:
        read = Reading(parameter="210", value=value, raw="000003E8", unit="Hz", name=name, time_s=time_s, **reading)
    return PollResult(
        item=PollItem(drive=None, parameter=name),
        drive="pump",
        parameter=name,
        reading=read,
        cause="" if error is None else str(error),
        error=error,
        time_s=time_s,
        due_s=0.0,
        late_s=0.0,
        took_s=0.1,
        missed=0,
    )


FAILED = NoReplyError("vabus:1 did not answer within 100 ms")


def test_row_holds_all_columns_as_texts():
    assert row_of(result(note="type and unit are derived")).texts() == {
        "time": "2026-09-21T14:13:20.125Z",
        "drive": "pump",
        "name": "output_frequency",
        "address": "210",
        "value": "10.00",
        "unit": "Hz",
        "text": "",
        "raw": "000003E8",
        "quality": "good",
        "note": "type and unit are derived",
    }


def test_stale_and_bad_rows_hold_the_cause():
    stale = row_of(result(error=FAILED))
    assert (stale.quality, stale.value, stale.note) == ("stale", "10.00", "vabus:1 did not answer within 100 ms")
    bad = row_of(result(None, error=FAILED))
    assert (bad.quality, bad.value, bad.unit, bad.number) == ("bad", "", "", None)
    assert not stale.is_fresh
    assert not bad.is_fresh


def test_number_of_a_row_is_none_unless_its_value_is_a_number():
    rows = [row_of(result(value)) for value in (7, Decimal("-0.5"), "running", "NaN")]
    assert [row.number for row in rows] == [7.0, -0.5, None, None]


def test_row_is_on_disk_when_write_returns(tmp_path):
    path = tmp_path / "log.csv"
    with open_log(path) as log:
        log.write(result())
        with path.open(encoding="utf-8", newline="") as file:
            (row,) = csv.DictReader(file)
        assert row["value"] == "10.00"
        log.write(result(text='14, "earth"\nfault'))
        assert log.written == 2
    rows = list(read_rows(path))
    assert [row.text for row in rows] == ["", '14, "earth" fault']


def test_time_drive_and_name_identify_a_row(tmp_path):
    path = tmp_path / "log.csv"
    times = [TIME, TIME, TIME + 0.0004, TIME + 0.001, TIME + 0.01, TIME - 3600]
    with open_log(path) as log:
        for time_s in times:
            log.write(result(None, error=FAILED, time_s=time_s))
            log.write(result(time_s=time_s, name="output_current"))
    rows = list(read_rows(path))
    assert len({(row.time, row.drive, row.name) for row in rows}) == len(rows) == 12
    mine = [row.time for row in rows if row.name == "output_current"]
    assert [round((time - mine[0]).total_seconds(), 3) for time in mine] == [0, 0.001, 0.002, 0.003, 0.01, -3600]


def test_error_leaves_no_empty_log_behind(tmp_path):
    for name in ("log.csv", "log.parquet"):
        with pytest.raises(NoReplyError), open_log(tmp_path / name):
            raise FAILED
    assert not list(tmp_path.iterdir())


def test_log_is_continued_and_loses_only_a_cut_off_row(tmp_path):
    path = tmp_path / "log.csv"
    for _ in range(2):
        with open_log(path) as log:
            log.write(result())
    whole = path.read_bytes()
    assert whole.count(b"time,drive") == 1
    path.write_bytes(whole[:-5])
    assert len(list(read_rows(path))) == 1
    with open_log(path) as log:
        log.write(result(Decimal("11.00")))
    assert [row.value for row in read_rows(path)] == ["10.00", "11.00"]


def test_cut_off_header_is_written_again(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"time,dri")
    with open_log(path) as log:
        log.write(result())
    assert len(list(read_rows(path))) == 1


def test_foreign_file_is_left_alone(tmp_path):
    path = tmp_path / "notes.csv"
    path.write_text("my,own,notes\n1,2,3\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"exists already and is not a value log; give another name"):
        open_log(path)
    assert path.read_text(encoding="utf-8") == "my,own,notes\n1,2,3\n"
    with pytest.raises(FileFormatError, match="is not a value log"):
        list(read_rows(path))


def test_parquet_log_holds_the_same_rows_and_numbers(tmp_path):
    path = tmp_path / "log.parquet"
    with open_log(path) as log:
        for value in (Decimal("10.00"), 7, "running"):
            log.write(result(value))
        log.write(result(None, error=FAILED))
        assert not path.exists()
        assert len(list(read_csv(journal_of(path)))) == 4
    assert [each.name for each in tmp_path.iterdir()] == ["log.parquet"]
    assert [row.value for row in read_rows(path)] == ["10.00", "7", "running", ""]
    table = parquet.read_table(path)
    assert set(table.column_names) == {*COLUMNS, "number"}
    assert table["number"].to_pylist() == [10.0, 7.0, None, None]
    assert table["time"].to_pylist()[0] == datetime(2026, 9, 21, 14, 13, 20, 125000, tzinfo=UTC)


def test_parquet_log_is_written_in_row_groups(tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.plant.value_log.parquet_files.ROWS_A_GROUP", 10)
    path = tmp_path / "log.parquet"
    with open_log(path) as log:
        for number in range(25):
            log.write(result(number))
    assert parquet.ParquetFile(path).num_row_groups == 3
    assert [row.number for row in read_rows(path)] == [float(number) for number in range(25)]


WRITER = """
import sys
sys.path[:0] = sys.argv[2:]
from pathlib import Path
from test_value_log import result
from drivecomm.plant.value_log import open_log
log = open_log(Path(sys.argv[1]))
for number in range(100):
    log.write(result(number))
print("written", flush=True)
sys.stdin.read()
"""


@pytest.mark.soak
def test_log_of_a_killed_program_is_read_and_continued(tmp_path):
    path = tmp_path / "log.parquet"
    command = [sys.executable, "-c", WRITER, str(path), str(Path(__file__).parent)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout.readline() == "written\n"
        writer.kill()
    assert not path.exists()
    assert len(list(read_rows(journal_of(path)))) == 100
    assert list(read_rows(path)) == list(read_rows(journal_of(path)))
    with open_log(path) as log:
        log.write(result(100))
    assert [row.number for row in read_rows(path)] == list(range(101))


def test_unusable_log_files_are_refused(tmp_path):
    there = tmp_path / "log.parquet"
    there.write_bytes(b"PAR1")
    for path, kind, message in (
        (tmp_path / "log.txt", UsageError, "a log is .csv or .parquet"),
        (tmp_path / "nowhere" / "log.csv", FileFormatError, "cannot be written as a log"),
        (there, FileFormatError, "exists already"),
    ):
        with pytest.raises(kind, match=message):
            open_log(path)
    for path, kind, message in (
        (tmp_path / "log.txt", UsageError, "a log is .csv or .parquet"),
        (tmp_path / "none.csv", FileFormatError, "cannot be read as a log"),
        (tmp_path / "none.parquet", FileFormatError, "cannot be read as Parquet"),
        (there, FileFormatError, "cannot be read as Parquet"),
    ):
        with pytest.raises(kind, match=message):
            list(read_rows(path))


def test_foreign_parquet_file_is_refused(tmp_path):
    path = tmp_path / "other.parquet"
    parquet.write_table(pa.table({"time": [1]}), path)
    with pytest.raises(FileFormatError, match="is not a value log; it must have the columns time, drive"):
        list(read_rows(path))


@pytest.mark.parametrize(
    "line",
    ["yesterday,p,n,,,,,,good,", "2026-01-01T00:00:00,p,n,,,,,,good,", "2026-01-01T00:00:00Z,p,n,,,,,,fine,", "x"],
)
def test_malformed_row_is_reported_with_its_line(tmp_path, line):
    path = tmp_path / "log.csv"
    path.write_text(",".join(COLUMNS) + "\n" + line + "\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"log.csv, line 2: not a row of a value log"):
        list(read_rows(path))


def test_parquet_log_without_pyarrow_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UsageError, match=r"install drivecomm\[log\], or use .csv"):
        open_log(tmp_path / "log.parquet")
    assert not list(tmp_path.iterdir())


_TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Zl", "Zp"]), max_size=12)
ROWS = st.builds(
    LogRow,
    time=st.integers(0, 4_000_000_000_000).map(
        lambda ms: datetime.fromtimestamp(ms / 1000, UTC).replace(microsecond=ms % 1000 * 1000)
    ),
    drive=_TEXT,
    name=_TEXT,
    value=_TEXT,
    unit=_TEXT,
    text=_TEXT,
    raw=_TEXT,
    quality=st.sampled_from(["good", "uncertain", "stale", "bad"]),
    note=_TEXT,
)


@pytest.mark.soak
@settings(max_examples=30)
@given(st.lists(ROWS, max_size=6))
def test_any_rows_are_read_back(tmp_path_factory, rows):
    folder = tmp_path_factory.mktemp("logs")
    for path, kind, read in (
        (folder / "log.csv", CsvLog, read_csv),
        (folder / "log.parquet", ParquetLog, read_parquet),
    ):
        log = kind(path)
        for row in rows:
            log.write(row)
        log.close()
        assert list(read(path)) == rows
