"""The folders in which programs of this machine find each other while they run: a user's own, and the system's."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

SYSTEM_FOLDER = Path("/run/drivecomm")
"""Where a service of the system has its records, as its unit says (RuntimeDirectory=drivecomm)."""

_OTHERS_MAY_WRITE = 0o002
_OTHERS_MAY_ANYTHING = 0o077


def users_folder() -> Path:
    """Return the folder of this user's programs; it need not exist."""
    if os.name == "posix" and (folder := os.environ.get("XDG_RUNTIME_DIR")):
        return Path(folder) / "drivecomm"
    # It takes long to load for a stop, and a login session on Linux does without it.
    from platformdirs import user_runtime_path  # noqa: PLC0415

    with warnings.catch_warnings():
        # Without a login session, as in a service, the folder is another one, which is as good.
        warnings.simplefilter("ignore")
        return user_runtime_path("drivecomm", appauthor=False)


def folder_of_servers() -> Path:
    """Return where a server writes its record: the folder that its service manager gives it, or its user's."""
    given = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(given) if given else users_folder()


def folders_to_search() -> tuple[Path, ...]:
    """Return where servers are looked for: only folders in which nobody else could have put something.

    The one in which a server would be begins: whoever names another one means that.
    """
    found = [folder for folder in (folder_of_servers(), users_folder()) if is_private(folder)]
    if os.name == "posix" and _only_service_writes(SYSTEM_FOLDER):
        found.append(SYSTEM_FOLDER)
    return tuple(dict.fromkeys(found))


def is_private(folder: Path) -> bool:
    """Whether nobody else can write to this folder; False if there is none."""
    try:
        found = folder.stat()
    except OSError:
        return False
    return os.name != "posix" or (found.st_uid == os.getuid() and not found.st_mode & _OTHERS_MAY_ANYTHING)


def _only_service_writes(folder: Path) -> bool:
    try:
        return not folder.stat().st_mode & _OTHERS_MAY_WRITE
    except OSError:
        return False
