"""Records that a process holds locked: what is removed meanwhile, or is no record, is never taken for one."""

import json
import os

import pytest

from drivecomm.client import locked_records
from drivecomm.client.locked_records import hold, read_held

pytestmark = pytest.mark.skipif(os.name != "posix", reason="flock is POSIX")


def test_record_that_its_holder_removes_before_it_is_locked_is_made_anew(tmp_path, monkeypatch):
    """Who ends removes the record that somebody else has opened already: locked, it would be nobody's to find."""
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
    # Nor can a second one have it.
    monkeypatch.setattr(locked_records, "_LOCK_S", 0.0)
    assert hold(path) is None
    held.release()
    assert not path.exists()


def test_record_that_is_written_anew_holds_nothing_of_the_longer_one(tmp_path):
    held = hold(tmp_path / "hall.json")
    held.write({"name": "a long one"})
    held.write({"a": 1})
    assert read_held(tmp_path / "hall.json") == {"a": 1}
    held.release()


def test_file_that_nobody_holds_link_and_pipe_are_no_records(tmp_path):
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
