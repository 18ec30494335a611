"""Journal of a restore: created at the first write, removed at the end, and valid after a power failure."""

import os

import pytest

from drivecomm.commissioning.parameter_sets import (
    ParameterEntry,
    ParameterSet,
    found_journal,
    journal_path,
    new_journal,
)
from drivecomm.errors import FileFormatError, UsageError


def a_set(value=1):
    entries = {"481": ParameterEntry(address="481", value=value)}
    return ParameterSet(protocol="vabus", drive="vabus:1", model="agile", entries=entries)


@pytest.fixture
def path(tmp_path):
    return journal_path(tmp_path / "pump.toml", "vabus:1")


def test_journal_lies_beside_the_set(path):
    assert path.name == "pump.toml.vabus-1.journal"


def test_journal_exists_from_the_first_write_to_the_end(path):
    journal = new_journal(path, a_set(), "vabus:1")
    assert not path.exists()
    journal.wrote("481")
    assert journal.written == {"481"}
    with pytest.raises(UsageError, match="was interrupted; continue it"):
        new_journal(path, a_set(), "vabus:1")
    journal.over()
    assert not path.exists()
    journal.over()


def test_each_line_is_on_the_disk_before_the_next_parameter_is_written(path, monkeypatch):
    on_disk = []
    monkeypatch.setattr("os.fsync", lambda descriptor: on_disk.append(os.fstat(descriptor).st_size))
    journal = new_journal(path, a_set(), "vabus:1")
    for address in ("480", "481"):
        journal.wrote(address)
        assert on_disk[-1] == path.stat().st_size
    assert len(on_disk) == 2


def test_found_journal_is_continued(path):
    assert found_journal(path, a_set(), "vabus:1").written == frozenset()
    new_journal(path, a_set(), "vabus:1").wrote("480")
    again = found_journal(path, a_set(), "vabus:1")
    assert again.written == {"480"}
    again.wrote("481")
    assert found_journal(path, a_set(), "vabus:1").written == {"480", "481"}
    assert path.read_text().count("restores") == 1


def test_parameter_in_a_cut_off_line_counts_as_not_written(path):
    journal = new_journal(path, a_set(), "vabus:1")
    journal.wrote("480")
    journal.wrote("481")
    whole = path.read_bytes()
    for length in range(whole.index(b"\n") + 1, len(whole)):
        path.write_bytes(whole[:length])
        found = found_journal(path, a_set(), "vabus:1")
        assert found.written == ({"480"} if whole[:length].count(b"\n") > 1 else frozenset())
        found.wrote("482")
        assert found_journal(path, a_set(), "vabus:1").written == found.written


def test_journal_with_a_cut_off_head_counts_as_empty(path):
    new_journal(path, a_set(), "vabus:1").wrote("480")
    head = path.read_bytes().split(b"\n")[0]
    for length in range(len(head)):
        path.write_bytes(head[:length])
        found = found_journal(path, a_set(), "vabus:1")
        assert found.written == frozenset()
        found.wrote("480")
        assert found_journal(path, a_set(), "vabus:1").written == {"480"}


@pytest.mark.parametrize(("known", "drive"), [(a_set(2), "vabus:1"), (a_set(), "vabus:2")])
def test_journal_of_another_restore_is_refused(path, known, drive):
    new_journal(path, a_set(), "vabus:1").wrote("481")
    with pytest.raises(FileFormatError, match="of another parameter set or drive, or the set was changed since"):
        found_journal(path, known, drive)


@pytest.mark.parametrize("text", ["what is this\n", "[]\n", '{"restores": 1}\n', "\udcff\n", "[" * 100_000 + "\n"])
def test_malformed_journal_is_refused(path, text):
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FileFormatError, match="journal"):
        found_journal(path, a_set(), "vabus:1")


def test_unwritable_journal_raises_usage_error(tmp_path):
    journal = new_journal(tmp_path / "nowhere" / "x.journal", a_set(), "vabus:1")
    with pytest.raises(UsageError, match="the journal cannot be written"):
        journal.wrote("481")
