"""Folders in which running programs of this machine find each other: that of the user, and that of the system."""

from __future__ import annotations

import os
import stat
import warnings
from contextlib import suppress
from pathlib import Path

SYSTEM_FOLDER = Path("/run/drivecomm")
"""Folder of the records of a system service, as in its unit file (RuntimeDirectory=drivecomm)."""

_OTHERS_MAY_WRITE = 0o022
_OTHERS_MAY_ANYTHING = 0o077
ROOT = 0


def users_folder() -> Path:
    """Return the folder of this user's programs, which may not exist yet.

    Raises OSError if the place for such folders is unusable, for example taken by another user.
    """
    if os.name == "posix" and (folder := os.environ.get("XDG_RUNTIME_DIR")):
        return _of_its_real_parent(Path(folder) / "drivecomm")
    # Imported late: the import is slow for a stop, and a login session on Linux does not need it.
    from platformdirs import user_runtime_path

    with warnings.catch_warnings():
        # Without a login session, as in a service, it warns about its fallback folder, which serves as well.
        warnings.simplefilter("ignore")
        return _of_its_real_parent(user_runtime_path("drivecomm", appauthor=False))


def folder_of_servers() -> Path:
    """Return the folder for a server's record: the one given by its service manager, or its user's."""
    given = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return _of_its_real_parent(Path(given)) if given else users_folder()


def folders_to_search() -> tuple[Path, ...]:
    """Return the folders in which to look for servers; only folders to which no other user can write.

    The first one is the folder of `folder_of_servers`, since a user who sets another folder means that one. A folder
    that is unusable is left out, see `unusable_reason`.
    """
    found = []
    for place in (folder_of_servers, users_folder):
        # Commands, and above all stops, must work without this folder.
        with suppress(Exception):
            folder = place()
            if is_private(folder):
                found.append(folder)
    if _owner_of_system_folder() is not None:
        found.append(SYSTEM_FOLDER)
    return tuple(dict.fromkeys(found))


def unusable_reason() -> str:
    """Return why this user's folder is unusable, empty if it is usable or does not exist yet."""
    try:
        folder = folder_of_servers()
        if not os.path.lexists(folder) or is_private(folder):
            return ""
    except Exception as error:  # noqa: BLE001 - any error is only reported
        return str(error)
    return privacy_error(folder)


def privacy_error(folder: Path) -> str:
    """Return the error text for a folder that other users can access."""
    return f"{folder} is not private to this user: another user could write to it"


def make_private(folder: Path) -> None:
    """Create a folder for this user only, unless it exists. Raises OSError, also if another user owns it."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (os.environ.get("RUNTIME_DIRECTORY") or is_private(folder)):
        raise PermissionError(privacy_error(folder))


def is_private(folder: Path) -> bool:
    """Return whether no other user can use or replace this folder; False if it does not exist."""
    try:
        found = os.lstat(folder)
        if os.name != "posix":
            return stat.S_ISDIR(found.st_mode)
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        return own and not found.st_mode & _OTHERS_MAY_ANYTHING and _parents_are_safe(folder)
    except OSError:
        return False


def trusted_users() -> frozenset[int]:
    """Return the users whose programs are trusted: this one, root, and that of the system service."""
    own = {ROOT, os.getuid()}
    service = _owner_of_system_folder()
    return frozenset(own if service is None else own | {service})


def _owner_of_system_folder() -> int | None:
    """Return the user of the system service; None if no folder exists that only root can have assigned to it."""
    if os.name != "posix":
        return None
    try:
        found = os.lstat(SYSTEM_FOLDER)
        above = os.lstat(SYSTEM_FOLDER.parent)
    except OSError:
        return None
    safe = stat.S_ISDIR(found.st_mode) and not found.st_mode & _OTHERS_MAY_WRITE
    roots = above.st_uid == ROOT and not above.st_mode & _OTHERS_MAY_WRITE
    return found.st_uid if safe and roots else None


def _of_its_real_parent(folder: Path) -> Path:
    """Return a folder below the real path of its parent, so that later changes of links have no effect."""
    return Path(os.path.realpath(folder.parent)) / folder.name


def _parents_are_safe(folder: Path) -> bool:
    """Return whether only this user and root can rename the parents of this folder. Raises OSError."""
    for parent in folder.parents:
        found = os.lstat(parent)
        if not stat.S_ISDIR(found.st_mode) or found.st_uid not in (ROOT, os.getuid()):
            return False
        # In a folder with the sticky bit, such as /tmp, users can rename only their own entries.
        if found.st_mode & _OTHERS_MAY_WRITE and not found.st_mode & stat.S_ISVTX:
            return False
    return True
