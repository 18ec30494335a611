"""A history whose process is killed, whose disk is full or hangs, or whose file is damaged."""

import os
import resource
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing

import pytest
from past_values import NOON, event, value

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server.history import History, HistoryWriter, journal as journals, store
from drivecomm.server.history.schema import open_for_writing

WRITER = """
import sys, time
from decimal import Decimal
from pathlib import Path
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.history import HistoryWriter

journal, number = HistoryWriter(Path(sys.argv[1])), 0
while True:
    batch = []
    for _ in range(50):
        reading = Reading(parameter="241", value=number, raw=number, time_s=time.time())
        batch.append(CurrentValue(drive="pump", name="f", reading=reading, quality="good", time_s=time.time()))
        number += 1
    journal.add_values(batch)
    sys.stdout.write(f"{number} {journal.written}\\n")
    sys.stdout.flush()
    time.sleep(0.002)
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / "history.sqlite"


@pytest.fixture
def said():
    return []


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(journals, "COMMITTED_EVERY_S", 0.01)
    monkeypatch.setattr(journals, "TRIED_AGAIN_S", 0.02)


def until(condition):
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def numbers(file, **wanted):
    with History(file) as history:
        return [each.raw for each in history.values("pump", **wanted) if each.quality == "good"]


@pytest.mark.soak
@pytest.mark.parametrize("seconds", [0.7, 1.3])
def test_killed_process_loses_only_uncommitted_values(file, seconds):
    """Committed values are complete and unique; only values of the last half second are lost."""
    with subprocess.Popen([sys.executable, "-c", WRITER, file], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline()
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
        handed_over, committed = map(int, process.stdout.read().splitlines()[-1].split())
    found = numbers(file)
    assert found == list(range(len(found)))
    assert committed <= len(found) <= handed_over + 50
    connection = sqlite3.connect(file)
    assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
    # The next server continues the file, and the history marks the time without a server.
    journal = HistoryWriter(file)
    journal.add_values([value(7, name="f", time_s=time.time())])
    journal.close()
    with History(file) as history:
        *_, before, gap, after = history.values("pump", "f")
    assert before.row + 1 == after.row == gap.row
    assert (gap.value, gap.quality, gap.note) == (None, "bad", "no values were recorded: no server was running")


def test_full_disk_loses_the_oldest_values_and_no_event(file, said, monkeypatch):
    monkeypatch.setattr(journals, "MOST_WAITING", 1000)
    monkeypatch.setattr(journals, "ROWS_A_COMMIT", 100)
    full = threading.Event()
    add = store.HistoryFile.add

    def add_while_there_is_room(self, values, others):
        if full.is_set():
            self._execute("PRAGMA max_page_count = 1")
        return add(self, [*values] * (1 if not full.is_set() else 100), others)

    monkeypatch.setattr(store.HistoryFile, "add", add_while_there_is_room)
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(n) for n in range(100)])
    until(lambda: journal.written == 100)
    full.set()
    for n in range(100, 5100, 100):
        journal.add_values([value(n + m) for m in range(100)])
        journal.add_events([event(n)])
    until(lambda: said and journal.missing == 4000)
    full.clear()
    until(lambda: journal.written == 1100)
    journal.close()
    assert numbers(file) == [*range(100), *range(4100, 5100)]
    with History(file) as history:
        assert [each.event.number for each in history.events()] == list(range(100, 5100, 100))
        (gap,) = (each for each in history.values() if each.quality == "bad")
        assert None in [point.value for point in history.points("pump", "output_frequency")]
    assert gap.time_s == NOON + 100
    assert gap.note == "values were lost, because of the history's file: database or disk is full"
    assert "database or disk is full; the history is not written from" in said[0]
    assert said[1:] == [f"{file}: writing the history has resumed; 4000 values are missing in all"]


def test_gap_is_recorded_although_its_first_writes_failed(file, said, monkeypatch):
    monkeypatch.setattr(journals, "MOST_WAITING", 100)
    monkeypatch.setattr(journals, "ROWS_A_COMMIT", 50)
    broken, tried, add = threading.Event(), [], store.HistoryFile.add

    def add_unless_broken(self, values, others):
        if broken.is_set():
            tried.append([each for each in others if isinstance(each, store.Gap)])
            raise sqlite3.OperationalError("disk I/O error")
        return add(self, values, others)

    monkeypatch.setattr(store.HistoryFile, "add", add_unless_broken)
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(0)])
    until(lambda: journal.written == 1)
    broken.set()
    for first in range(1, 201, 50):
        journal.add_values([value(n) for n in range(first, first + 50)])
    # The gap was in several failed batches, and nothing has been dropped since.
    until(lambda: len(tried) >= 3 and all(tried[-2:]))
    broken.clear()
    until(lambda: journal.written == 101)
    journal.close()
    with History(file) as history:
        (gap,) = (each for each in history.values() if each.quality == "bad")
    assert gap.time_s == NOON + 1
    assert gap.note == "values were lost, because of the history's file: disk I/O error"


def test_quantity_and_text_of_a_rolled_back_batch_are_written_again(file):
    """A batch fails at a value that cannot be stored.

    The new quantity and text of that batch must be written again with the next value.
    """
    with closing(store.HistoryFile(file)) as opened:
        opened.add([value(1, name="new", text="a text"), value(2, name="new", time_s=float("nan"))], [])
        opened.add([value(3, name="new", text="a text")], [])
    with History(file) as history:
        assert [(each.raw, each.text) for each in history.values("pump", "new")] == [(1, "a text"), (3, "a text")]


def test_file_size_limit_of_the_system_loses_no_value(file, said):
    """The operating system refuses to let the file grow, as on a full disk."""
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(n) for n in range(100)])
    until(lambda: journal.written == 100)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        journal.add_values([value(n) for n in range(100, 1000)])
        until(lambda: said)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    until(lambda: journal.written == 1000)
    journal.close()
    assert numbers(file) == list(range(1000))
    assert journal.missing == 0


def test_hanging_disk_does_not_block_the_caller(file, said, monkeypatch):
    goes_on = threading.Event()
    add = store.HistoryFile.add
    monkeypatch.setattr(store.HistoryFile, "add", lambda *given: goes_on.wait(30) and add(*given))
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(1)])
    until(lambda: not journal._values)
    began = time.perf_counter()
    for n in range(2, 100):
        journal.add_values([value(n)])
        journal.add_events([event(n)])
    journal.close(timeout_s=0.2)
    assert time.perf_counter() - began < 10
    assert said == [f"{file}: the disk does not answer; what was not yet written to the history is lost"]
    goes_on.set()
    journal._thread.join(10)
    assert numbers(file) == list(range(1, 100))


def test_full_disk_at_the_start_delays_only_the_history(file, said, monkeypatch):
    begin = journals.HistoryFile
    full = [True]

    def opened(path):
        if full[0]:
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise error
        return begin(path)

    monkeypatch.setattr(journals, "HistoryFile", opened)
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(1)])
    full[0] = False
    until(lambda: journal.written == 1)
    journal.close()
    assert numbers(file) == [1]
    assert len(said) == 2


@pytest.mark.parametrize("damage", [b"no database at all" * 1000, b"SQLite format 3\0" + b"\xff" * 9000])
def test_damaged_file_is_renamed_at_the_start(file, said, damage):
    file.write_bytes(damage)
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(1)])
    journal.close()
    assert numbers(file) == [1]
    (aside,) = file.parent.glob("history.sqlite.damaged-*")
    assert aside.read_bytes() == damage
    assert said == [f"{file}: is damaged; it is kept as {aside.name}, and a new history begins"]


@pytest.mark.soak
def test_file_damaged_while_open_is_renamed(file, said):
    journal = HistoryWriter(file, tell=said.append)
    journal.add_values([value(n) for n in range(20_000)])
    until(lambda: journal.written == 20_000)
    journal._store._execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    with file.open("r+b") as raw:
        raw.seek(4096)
        raw.write(b"\xa5" * (file.stat().st_size - 4096))
    journal._store._execute("PRAGMA shrink_memory")
    journal._store._execute("PRAGMA cache_size = 0")
    journal.add_values([value(n, name="other") for n in range(20_000, 20_100)])
    until(lambda: journal.written == 20_100)
    journal.close()
    assert numbers(file) == list(range(20_000, 20_100))
    assert len(list(file.parent.glob("history.sqlite.damaged-*"))) >= 1
    assert "is damaged; it is kept as" in said[0]


def test_database_of_another_program_is_refused_and_unchanged(file):
    connection = sqlite3.connect(file)
    connection.execute("CREATE TABLE precious (x)")
    connection.close()
    before = file.read_bytes()
    with pytest.raises(FileFormatError, match="is a database of another program; name another file"):
        HistoryWriter(file)
    assert file.read_bytes() == before


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such permissions")
@pytest.mark.parametrize("before", [None, 0o644, 0o660])
def test_history_files_are_not_accessible_to_other_users(tmp_path, before):
    file = tmp_path / "history.sqlite"
    if before is not None:
        with closing(open_for_writing(file)):
            pass
        file.chmod(before)
    mask = os.umask(0o022)
    try:
        with closing(open_for_writing(file)) as connection:
            connection.execute("INSERT INTO event (text) VALUES ('text')")
            modes = {each.name: each.stat().st_mode & 0o777 for each in tmp_path.iterdir()}
    finally:
        os.umask(mask)
    kept = 0o600 if before is None else before & ~0o007
    assert modes == {"history.sqlite": kept, "history.sqlite-wal": kept, "history.sqlite-shm": kept}


def test_history_below_a_file_instead_of_a_folder_is_refused(tmp_path):
    (tmp_path / "no folder").write_text("")
    with pytest.raises(FileFormatError, match=r"history\.sqlite: cannot be written as a history: "):
        HistoryWriter(tmp_path / "no folder" / "history.sqlite")


@pytest.mark.skipif("os.getuid() == 0", reason="root may write everywhere")
def test_history_in_a_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FileFormatError, match="cannot be written as a history: unable to open database file"):
        HistoryWriter(tmp_path / "history.sqlite")
    tmp_path.chmod(0o700)


def test_second_writer_is_refused_and_the_first_continues(file):
    journal = HistoryWriter(file)
    program = "import sys, pathlib, drivecomm.server.history as one; one.HistoryWriter(pathlib.Path(sys.argv[1]))"
    second = subprocess.run([sys.executable, "-c", program, file], capture_output=True, text=True, check=False)
    assert "another server writes this history; stop it, or give this one another file" in second.stderr
    with pytest.raises(FileFormatError, match="another server writes this history"):
        HistoryWriter(file)
    journal.add_values([value(1)])
    journal.close()
    assert numbers(file) == [1]
    HistoryWriter(file).close()


def test_history_refuses_invalid_limits(file):
    for limits in ({"days": 0}, {"megabytes": 1}):
        with pytest.raises(UsageError, match="a history keeps more than 0 days and at least 10 megabytes"):
            HistoryWriter(file, **limits)
    assert not file.exists()
