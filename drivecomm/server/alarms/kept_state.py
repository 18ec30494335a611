"""Alarm state that survives a restart of the server: standing alarms and undelivered messages."""

from __future__ import annotations

import dataclasses
import json
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError
from drivecomm.server.alarms.alarm import Alarm
from drivecomm.server.alarms.delivery import UndeliveredAlarm
from drivecomm.server.alarms.receivers import key_of
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

_FORMAT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredAlarms:
    """The state of all alarms.

    number: number of the last alarm. alarms: the standing ones. waiting: undelivered alarms.
    """

    number: int = 0
    alarms: tuple[Alarm, ...] = ()
    waiting: tuple[UndeliveredAlarm, ...] = ()


def write_state(path: Path, state: StoredAlarms) -> None:
    """Replace the state file; the folder is created if missing.

    Raises FileFormatError if the file cannot be written.
    """
    content = {
        "format": _FORMAT,
        "number": state.number,
        "alarms": [dataclasses.asdict(alarm) for alarm in state.alarms],
        "waiting": [{"to": key_of(each.to), "entry": dict(each.entry)} for each in state.waiting],
    }
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_atomically(path, json.dumps(content, indent=1) + "\n")


def read_state(path: Path, receivers: Iterable[str]) -> StoredAlarms:
    """Return the state in a file, an empty one if there is no file yet. receivers: entries of the plant file.

    Raises FileFormatError for a damaged file.
    """
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        return StoredAlarms()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from error
    by_key = {key_of(entry): entry for entry in receivers}
    try:
        content = json.loads(text)
        if content["format"] != _FORMAT:
            raise FileFormatError(f"{path}: format {content['format']} is not known")
        return StoredAlarms(
            number=int(content["number"]),
            alarms=tuple(Alarm(**each) for each in content["alarms"]),
            waiting=_waiting(content["waiting"], by_key),
        )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FileFormatError(f"{path}: cannot be read as the state of alarms: {error}") from error


def _waiting(content: Sequence[Any], by_key: dict[str, str]) -> tuple[UndeliveredAlarm, ...]:
    return tuple(
        UndeliveredAlarm(to=by_key[each["to"]], entry=each["entry"]) for each in content if each["to"] in by_key
    )
