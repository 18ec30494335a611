"""Locked records of processes: a removed record, a link, a pipe or an unheld file never counts as a record."""

import json
import os

import pytest

from drivecomm.client import locked_records
from drivecomm.client.locked_records import hold, read_held

pytestmark = pytest.mark.skipif(os.name != "posix", reason="flock is POSIX")


def test_record_removed_before_it_is_locked_is_created_again(tmp_path, monkeypatch):
    """An ending process may remove the file that another has just opened; a lock on that file would be useless."""
    path, take, removed = tmp_path / "hall.json", locked_records._take, []

    def take_late(descriptor):
        if not removed:
            removed.append(path.unlink())
        return take(descriptor)

    monkeypatch.setattr(locked_records, "_take", take_late)
    held = hold(path)
    held.write({"pid": 7})
    assert removed
    assert read_held(path) == {"pid": 7}
    # A second holder cannot lock the new file.
    monkeypatch.setattr(locked_records, "_LOCK_S", 0.0)
    assert hold(path) is None
    held.release()
    assert not path.exists()


def test_rewritten_record_holds_nothing_of_a_longer_earlier_one(tmp_path):
    held = hold(tmp_path / "hall.json")
    held.write({"name": "a long one"})
    held.write({"a": 1})
    assert read_held(tmp_path / "hall.json") == {"a": 1}
    held.release()


def test_unheld_file_link_and_pipe_are_not_records(tmp_path):
    (tmp_path / "left.json").write_text(json.dumps({"pid": 1}))
    held = hold(tmp_path / "held.json")
    held.write({"pid": 1})
    (tmp_path / "link.json").symlink_to(tmp_path / "held.json")
    os.mkfifo(tmp_path / "pipe.json")
    for name in ("left", "link", "pipe", "missing"):
        assert read_held(tmp_path / f"{name}.json") is None
    assert read_held(tmp_path / "held.json") == {"pid": 1}
    with pytest.raises(OSError, match="link"):
        hold(tmp_path / "link.json")
    held.release()
