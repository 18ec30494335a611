"""Upgrade of the tables of a record, one whole version at a time and without loss of rows, when it is opened."""

from contextlib import closing

import pytest
from postgres import needs_postgres, postgres

from drivecomm.errors import LinkDownError, UsageError
from drivecomm.server.record import tables
from drivecomm.server.record.opening import open_record


@pytest.fixture(params=["file", pytest.param("postgres", marks=needs_postgres)])
def url(request, tmp_path):
    """Return the place of a record that has one plant, in the tables of version 1."""
    if request.param == "file":
        place = str(tmp_path / "record.sqlite")
        add_plant(place)
        yield place
    else:
        with postgres() as running:
            add_plant(running.url)
            yield running.url


@pytest.fixture
def newer(url, monkeypatch):
    """Return the record, to be opened by a drivecomm whose tables are two versions ahead."""
    monkeypatch.setattr(tables, "VERSION", 3)
    upgrades = {1: ("ALTER TABLE plant ADD COLUMN site text",), 2: ("ALTER TABLE event ADD COLUMN duration text",)}
    monkeypatch.setattr(tables, "UPGRADES", upgrades)
    return url


def add_plant(url):
    with closing(open_record(url)) as database:
        database.all("INSERT INTO plant (name, state) VALUES ('hall', 'online')")


def test_opening_upgrades_earlier_tables_and_keeps_their_rows(newer):
    for _ in range(2):
        with closing(open_record(newer)) as database:
            assert database.all("SELECT version FROM record") == [(3,)]
            assert database.all("SELECT name, state, site FROM plant") == [("hall", "online", None)]
            assert database.all("SELECT duration FROM event") == []


def test_failed_upgrade_changes_nothing(newer, monkeypatch):
    monkeypatch.setitem(tables.UPGRADES, 2, ("ALTER TABLE missing ADD COLUMN x text",))
    with pytest.raises((LinkDownError, ValueError), match="missing"):
        open_record(newer)
    monkeypatch.setattr(tables, "VERSION", 1)
    with closing(open_record(newer)) as database:
        assert database.all("SELECT name FROM plant") == [("hall",)]


def test_tables_of_a_newer_drivecomm_are_refused_with_the_remedy(url):
    with closing(open_record(url)) as database:
        database.all("UPDATE record SET version = 2")
    with pytest.raises(UsageError, match=r"newer drivecomm \(version 2, this one knows 1\); update drivecomm"):
        open_record(url)


def test_record_without_a_version_is_refused(url):
    with closing(open_record(url)) as database:
        database.all("DELETE FROM record")
    with pytest.raises(UsageError, match=r"newer drivecomm \(version None, this one knows 1\)"):
        open_record(url)


def test_every_earlier_version_has_its_upgrade():
    assert sorted(tables.UPGRADES) == list(range(1, tables.VERSION))
