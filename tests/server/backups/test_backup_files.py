"""Backup files: written only after a change, written whole, limited in number, and committed to git on request."""

import subprocess
from dataclasses import replace

import pytest

from drivecomm.commissioning.parameter_sets import ParameterEntry, ParameterSet, read_set
from drivecomm.server.backups.shelf import Shelf, change_text

DAY_S = 86400.0


def set_of(*entries, **told):
    return ParameterSet(
        protocol="vabus",
        drive="vabus:1",
        model="agile",
        entries={entry.address: entry for entry in entries},
        **{"identity": {"serial number": "4711"}, **told},
    )


RAMP = ParameterEntry(address="420", name="acceleration", value=5, unit="s", part="settings")
FREQUENCY = ParameterEntry(address="480", name="fixed", value=50, unit="Hz", part="settings")
KNOWN = set_of(RAMP, FREQUENCY)


@pytest.fixture
def shelf(tmp_path):
    return Shelf(tmp_path / "backups")


def kept(shelf, known, day, most=30, extent="settings"):
    return shelf.keep("pump", known, extent, most=most, time_s=day * DAY_S)


def test_first_set_is_written_to_a_file_named_by_its_time(shelf):
    found = kept(shelf, KNOWN, 0)
    assert found.file == shelf.folder / "pump" / "1970-01-01T00-00-00Z.toml"
    assert read_set(found.file).entries == KNOWN.entries
    assert (found.before, found.changed, found.another) == (None, (), ())


def test_unchanged_set_is_not_written_again(shelf):
    first = kept(shelf, KNOWN, 0)
    assert kept(shelf, KNOWN, 1).file is None
    assert shelf.files("pump") == [first.file]


def test_changed_parameter_is_written_and_named(shelf):
    first = kept(shelf, KNOWN, 0)
    found = kept(shelf, set_of(replace(RAMP, value=7), FREQUENCY), 1)
    assert (found.before, list(map(change_text, found.changed))) == (first.file, ["420 acceleration: 5 s -> 7 s"])
    assert shelf.files("pump") == [first.file, found.file]


def test_unreadable_parameter_is_not_a_change(shelf):
    kept(shelf, KNOWN, 0)
    assert kept(shelf, set_of(RAMP, not_read={"480": "no reply"}), 1).file is None


def test_parameter_read_for_the_first_time_is_stored(shelf):
    kept(shelf, set_of(RAMP, not_read={"480": "no reply"}), 0)
    found = kept(shelf, KNOWN, 1)
    assert (found.file is not None, list(found.changed)) == (True, [])


def test_changed_measured_value_is_not_a_change(shelf):
    hours = ParameterEntry(address="245", value=1, part="measured")
    kept(shelf, set_of(RAMP, hours), 0)
    assert kept(shelf, set_of(RAMP, replace(hours, value=2)), 1).file is None


def test_other_serial_number_is_reported_as_another_drive(shelf):
    kept(shelf, KNOWN, 0)
    found = kept(shelf, replace(KNOWN, identity={"serial number": "9999"}), 1)
    assert list(found.another) == ["serial number was '4711' and is '9999'"]
    assert found.file is not None


def test_oldest_files_are_removed_and_full_backups_stay(shelf):
    everything = kept(shelf, KNOWN, 0, extent="everything").file
    files = [kept(shelf, set_of(replace(RAMP, value=day)), day, most=3).file for day in range(1, 6)]
    assert shelf.files("pump") == files[-3:]
    assert shelf.files("pump", "everything") == [everything]


def test_damaged_file_does_not_prevent_the_next_backup(shelf):
    first = kept(shelf, KNOWN, 0)
    first.file.write_text("half a fi")
    found = kept(shelf, KNOWN, 1)
    assert (found.file is not None, found.before) == (True, None)


def test_sets_of_a_drive_are_listed_with_their_times_newest_first(shelf):
    changed = set_of(replace(RAMP, value=7), FREQUENCY)
    kept(shelf, KNOWN, 0)
    kept(shelf, changed, 1).file.write_text("half a fi")
    kept(shelf, changed, 2)
    kept(shelf, KNOWN, 3, extent="everything")
    assert [(time_s, known.entries["420"].value) for time_s, known in shelf.sets("pump")] == [(2 * DAY_S, 7), (0.0, 5)]


@pytest.mark.parametrize("name", ["..", "a/b", "PUMP", "con", "Pumpe Süd"])
def test_folder_of_an_unusual_drive_name_stays_in_the_backup_folder(shelf, name):
    file = shelf.keep(name, KNOWN, "settings", most=3, time_s=0.0).file
    assert file.parent.parent == shelf.folder
    assert shelf.files(name) == [file]
    assert shelf.files("pump") == []


@pytest.fixture
def work_tree(tmp_path, monkeypatch):
    for key in ("GIT_AUTHOR_NAME", "GIT_COMMITTER_NAME"):
        monkeypatch.setenv(key, "plant")
    for key in ("GIT_AUTHOR_EMAIL", "GIT_COMMITTER_EMAIL"):
        monkeypatch.setenv(key, "plant@example.com")

    def git(*words):
        return subprocess.run(["git", *words], cwd=tmp_path, check=True, capture_output=True, text=True).stdout

    git("init", "--quiet")
    return git


def test_each_change_is_committed_with_its_own_files_only(work_tree, tmp_path):
    shelf = Shelf(tmp_path / "backups", git=True)
    (tmp_path / "half done.txt").write_text("of a person")
    work_tree("add", "half done.txt")
    assert kept(shelf, KNOWN, 0, most=1).trouble == ""
    assert kept(shelf, KNOWN, 1, most=1).trouble == ""
    assert kept(shelf, set_of(replace(RAMP, value=7), FREQUENCY), 2, most=1).trouble == ""
    assert work_tree("log", "--format=%s").splitlines() == [
        "Back up pump: 1 parameter changed",
        "Back up pump: first backup",
    ]
    assert work_tree("show", "--format=%b", "--no-patch").strip() == "420 acceleration: 5 s -> 7 s"
    assert work_tree("ls-tree", "-r", "--name-only", "HEAD").split() == ["backups/pump/1970-01-03T00-00-00Z.toml"]
    assert work_tree("status", "--short").splitlines() == ['A  "half done.txt"']


def test_backup_outside_a_work_tree_is_written_and_the_git_error_reported(shelf, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(shelf.folder.parent.parent))
    found = kept(Shelf(shelf.folder, git=True), KNOWN, 0)
    assert found.file.exists()
    assert "not a git repository" in found.trouble
