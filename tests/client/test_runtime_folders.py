"""Trust in runtime folders: by type, mode, owner and parent folder, and never by name."""

import os
from pathlib import Path

import pytest

from drivecomm.client import runtime_folders
from drivecomm.client.runtime_folders import folders_to_search, is_private, make_private, unusable_reason, users_folder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and modes are POSIX")

NOBODY = 65534
as_root = pytest.mark.skipif(os.name == "posix" and os.getuid() != 0, reason="only root can give a folder away")


@pytest.fixture
def folder(tmp_path):
    found = tmp_path / "above" / "folder"
    found.mkdir(parents=True, mode=0o700)
    found.parent.chmod(0o755)
    return found


def test_folder_of_this_user_alone_is_private(folder):
    assert is_private(folder)


@pytest.mark.parametrize("mode", [0o701, 0o702, 0o704, 0o710, 0o720, 0o740, 0o750, 0o755, 0o770, 0o777])
def test_folder_that_others_can_read_write_or_enter_is_not_private(folder, mode):
    folder.chmod(mode)
    assert not is_private(folder)


def test_link_to_a_private_folder_is_not_private(folder):
    link = folder.with_name("link")
    link.symlink_to(folder)
    assert not is_private(link)


def test_file_and_missing_path_are_not_private(folder):
    (folder / "file").touch(mode=0o600)
    assert not is_private(folder / "file")
    assert not is_private(folder / "nothing")


@pytest.mark.parametrize(("mode", "safe"), [(0o777, False), (0o775, False), (0o757, False), (0o1777, True)])
def test_folder_is_private_only_if_others_cannot_rename_it(folder, mode, safe):
    folder.parent.chmod(mode)
    assert is_private(folder) is safe


@as_root
def test_folder_of_another_user_or_inside_such_a_folder_is_not_private(folder):
    os.chown(folder, NOBODY, NOBODY)
    assert not is_private(folder)
    os.chown(folder, 0, 0)
    os.chown(folder.parent, NOBODY, NOBODY)
    assert not is_private(folder)


def test_users_folder_is_given_by_its_real_path(folder, monkeypatch, tmp_path):
    """A link in the path is resolved once, so changing the link later has no effect."""
    (tmp_path / "link").symlink_to(folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "link"))
    assert users_folder() == folder / "drivecomm"


def test_folder_that_cannot_be_made_private_is_refused(folder):
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="not private to this user"):
        make_private(folder)


def test_unusable_folder_is_left_out_and_named(monkeypatch, folder):
    def fall():
        raise PermissionError("taken")

    monkeypatch.setattr(runtime_folders, "users_folder", fall)
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert set(folders_to_search()) <= {runtime_folders.SYSTEM_FOLDER}
    assert unusable_reason() == "taken"
    monkeypatch.setattr(runtime_folders, "users_folder", lambda: folder)
    assert unusable_reason() == ""
    folder.chmod(0o777)
    assert "not private to this user" in unusable_reason()


@as_root
def test_service_is_trusted_only_in_a_folder_created_by_root(monkeypatch, tmp_path):
    system = tmp_path / "run" / "drivecomm"
    system.mkdir(parents=True, mode=0o755)
    os.chown(system, NOBODY, NOBODY)
    monkeypatch.setattr(runtime_folders, "SYSTEM_FOLDER", system)
    assert NOBODY in runtime_folders.trusted_users()
    assert system in folders_to_search()
    system.parent.chmod(0o777)
    assert NOBODY not in runtime_folders.trusted_users()
    system.parent.chmod(0o755)
    system.chmod(0o775)
    assert NOBODY not in runtime_folders.trusted_users()
    system.rmdir()
    system.symlink_to(tmp_path)
    assert NOBODY not in runtime_folders.trusted_users()
    assert system not in folders_to_search()


def test_users_folder_of_a_login_session_is_in_its_runtime_directory(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert users_folder() == Path(os.path.realpath(tmp_path)) / "drivecomm"
