"""The folders in which programs of this machine find each other while they run: a user's own, and the system's."""

from __future__ import annotations

import os
import stat
import warnings
from contextlib import suppress
from pathlib import Path

SYSTEM_FOLDER = Path("/run/drivecomm")
"""Where a service of the system has its records, as its unit says (RuntimeDirectory=drivecomm)."""

_OTHERS_MAY_WRITE = 0o022
_OTHERS_MAY_ANYTHING = 0o077
ROOT = 0


def users_folder() -> Path:
    """Return the folder of this user's programs; it need not exist.

    Raises OSError if the place for such folders cannot be used, such as one that another user has taken.
    """
    if os.name == "posix" and (folder := os.environ.get("XDG_RUNTIME_DIR")):
        return _of_its_real_parent(Path(folder) / "drivecomm")
    # It takes long to load for a stop, and a login session on Linux does without it.
    from platformdirs import user_runtime_path

    with warnings.catch_warnings():
        # Without a login session, as in a service, the folder is another one, which is as good.
        warnings.simplefilter("ignore")
        return _of_its_real_parent(user_runtime_path("drivecomm", appauthor=False))


def folder_of_servers() -> Path:
    """Return where a server writes its record: the folder that its service manager gives it, or its user's."""
    given = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return _of_its_real_parent(Path(given)) if given else users_folder()


def folders_to_search() -> tuple[Path, ...]:
    """Return where servers are looked for: only folders in which nobody else could have put something.

    The one in which a server would be begins: whoever names another one means that. A folder that cannot be used is
    left out, see `why_unusable`.
    """
    found = []
    for place in (folder_of_servers, users_folder):
        # Drives are commanded without it, and above all stopped.
        with suppress(Exception):
            folder = place()
            if is_private(folder):
                found.append(folder)
    if _owner_of_system_folder() is not None:
        found.append(SYSTEM_FOLDER)
    return tuple(dict.fromkeys(found))


def why_unusable() -> str:
    """Return why this user's folder cannot be used, empty if it can, or if there is none yet."""
    try:
        folder = folder_of_servers()
        if not os.path.lexists(folder) or is_private(folder):
            return ""
    except Exception as error:  # noqa: BLE001 - whatever it is, it is only said
        return str(error)
    return not_private(folder)


def not_private(folder: Path) -> str:
    """Return the sentence about a folder that is not this user's alone."""
    return f"{folder} is not a folder of this user alone: another user could put something there"


def make_private(folder: Path) -> None:
    """Make a folder of this user alone unless there is one. Raises OSError, also for one of somebody else."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (os.environ.get("RUNTIME_DIRECTORY") or is_private(folder)):
        raise PermissionError(not_private(folder))


def is_private(folder: Path) -> bool:
    """Whether nobody else can use this folder, or put another one in its place; False if there is none."""
    try:
        found = os.lstat(folder)
        if os.name != "posix":
            return stat.S_ISDIR(found.st_mode)
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        return own and not found.st_mode & _OTHERS_MAY_ANYTHING and _parents_are_safe(folder)
    except OSError:
        return False


def trusted_users() -> frozenset[int]:
    """Return the users whose programs are believed: this one, root, and that of the system's service."""
    own = {ROOT, os.getuid()}
    service = _owner_of_system_folder()
    return frozenset(own if service is None else own | {service})


def _owner_of_system_folder() -> int | None:
    """Return the user of the system's service; None where there is no folder that only root could have given it."""
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
    """Return a folder by the real path of what it is in: links on the way are followed now, and never again."""
    return Path(os.path.realpath(folder.parent)) / folder.name


def _parents_are_safe(folder: Path) -> bool:
    """Whether only this user and root can rename what this folder is in. Raises OSError."""
    for parent in folder.parents:
        found = os.lstat(parent)
        if not stat.S_ISDIR(found.st_mode) or found.st_uid not in (ROOT, os.getuid()):
            return False
        # In a folder with the sticky bit, such as /tmp, nobody renames what belongs to others.
        if found.st_mode & _OTHERS_MAY_WRITE and not found.st_mode & stat.S_ISVTX:
            return False
    return True
