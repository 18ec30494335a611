"""Upgrade of the tables of a history, one whole version at a time and without loss of rows, when a server opens it."""

import sqlite3
from contextlib import closing

import pytest
from past_values import value

from drivecomm.errors import FileFormatError
from drivecomm.server.history import History, Journal, schema


@pytest.fixture
def file(tmp_path):
    """Return a history with two values, written with the tables of version 1."""
    path = tmp_path / "history.sqlite"
    journal = Journal(path)
    journal.add_values([value(1), value(2)])
    journal.close()
    return path


@pytest.fixture
def newer(file, monkeypatch):
    """Return the history, to be opened by a drivecomm whose tables are two versions ahead."""
    monkeypatch.setattr(schema, "VERSION", 3)
    upgrades = {1: "ALTER TABLE event ADD COLUMN alarm TEXT;", 2: "ALTER TABLE gap ADD COLUMN drive TEXT;"}
    monkeypatch.setattr(schema, "UPGRADES", upgrades)
    return file


def version_of(file):
    with closing(sqlite3.connect(file)) as connection:
        return connection.execute("PRAGMA user_version").fetchone()[0]


def columns(file, table):
    with closing(sqlite3.connect(file)) as connection:
        return [name for _, name, *_ in connection.execute(f"PRAGMA table_info({table})")]


def test_server_upgrades_earlier_tables_and_keeps_their_rows(newer):
    Journal(newer).close()
    assert version_of(newer) == 3
    assert columns(newer, "event")[-1] == "alarm"
    assert columns(newer, "gap")[-1] == "drive"
    with History(newer) as history:
        assert [each.raw for each in history.values("pump", "output_frequency")] == [1, 2]


def test_reader_refuses_earlier_tables_and_names_the_remedy(newer):
    before = newer.read_bytes()
    with pytest.raises(FileFormatError, match=r"older drivecomm \(format 1, this one reads 3\); start its server once"):
        History(newer)
    assert newer.read_bytes() == before


def test_failed_upgrade_leaves_the_tables_at_the_last_completed_version(newer, monkeypatch):
    monkeypatch.setitem(schema.UPGRADES, 2, "ALTER TABLE gap ADD COLUMN drive TEXT; ALTER TABLE missing ADD COLUMN x;")
    with pytest.raises(sqlite3.OperationalError, match="missing"):
        schema.open_for_writing(newer)
    assert version_of(newer) == 2
    assert "drive" not in columns(newer, "gap")


def test_every_earlier_version_has_its_upgrade():
    assert sorted(schema.UPGRADES) == list(range(1, schema.VERSION))
