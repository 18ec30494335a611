"""Audit trail of commands: append-only JSON Lines, written before a command is sent.

Each line has a `time` (UTC) and its `record`: "asked" before a command goes out, with the `decision`, allowed or
refused; "outcome" for the result; "gap" where records could not be written. Lines of one command have the same
`number`, within one `session` of the server. Tokens, passwords and the keys of leases are never written.
"""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from enum import Enum
from itertools import count, islice
from math import isfinite
from threading import Lock, Thread
from time import time
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text
from drivecomm.errors import NotAllowedError, in_one_line, shortened
from drivecomm.server.audit_lines import FILE_BYTES, FILES, AuditFile

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandAnswer, CommandRequest
    from drivecomm.server.leases import Lease

LONGEST_WAIT_S = 2.0
"""Longest time that a command waits for the disk."""
_MOST_WAITING = 10_000
_LONGEST_TEXT = 500
_DEEPEST = 4
_MOST_ITEMS = 100
_LARGEST = 2**63
_LONGEST_NUMBER = 40
_SHORTEST_KEY = 16
_SLOW = "the disk does not answer"
_SECRET = frozenset({"key", "lease", "password", "secret", "token", "authorization"})


class Audit:
    """The audit of commands, written by a separate thread that flushes each record to the disk.

    tell: called with a sentence when records cannot be written, and when writing works again; runs in the event loop in
    which this object was made. session: session of this run of the server. A file that cannot be written is retried
    with each record.
    """

    def __init__(
        self,
        file: Path,
        tell: Callable[[str], None],
        *,
        session: str = "",
        file_bytes: int = FILE_BYTES,
        files: int = FILES,
        clock: Callable[[], float] = time,
    ) -> None:
        self._tell, self._session, self._clock = tell, session, clock
        self._file = AuditFile(file, file_bytes, files)
        self._numbers = count(1)
        self._loop = asyncio.get_running_loop()
        self._counting = Lock()
        self._failing = False
        self._lost = 0
        self._waiting: queue.Queue[tuple[bytes, Future[None]] | None] = queue.Queue(_MOST_WAITING)
        self._thread = Thread(target=self._write_all, name="audit", daemon=True)
        self._thread.start()

    async def record_command(self, caller: Caller, command: CommandRequest, lease: Lease | None = None) -> int:
        """Record that a command is about to be sent; return the number of the record.

        Waits until the record is on the disk. Raises NotAllowedError if it cannot be written.
        """
        said = {"decision": "allowed", "holder": str(lease.holder) if lease else ""}
        number, written = self._record("asked", caller, command, said)
        try:
            await asyncio.wait_for(asyncio.wrap_future(written), LONGEST_WAIT_S)
        except OSError as error:
            # TimeoutError is an OSError, too.
            reason = error.strerror or _SLOW
            if isinstance(error, TimeoutError):
                self._record("outcome", caller, command, {"outcome": "refused", "why": reason}, number)
            raise NotAllowedError(
                f"{command.verb} of {command.drive} was not sent, because its audit record cannot be written: "
                f"{self._file.path}: {reason}; a stop would still be sent"
            ) from error
        return number

    def record_stop(self, caller: Caller, command: CommandRequest) -> int:
        """Queue the audit record of a stop and return its number; never waits for the disk."""
        return self._record("asked", caller, command, {"decision": "allowed"})[0]

    def refused(self, caller: Caller, command: CommandRequest, why: str) -> None:
        """Queue the record of a refused command with the reason; never waits for the disk."""
        self._record("asked", caller, command, {"decision": "refused", "why": why})

    def outcome(self, caller: Caller, command: CommandRequest, number: int, answer: CommandAnswer) -> None:
        """Queue the record of a command's outcome; never waits for the disk."""
        said = {"outcome": answer.outcome, "why": "" if answer.error is None else in_one_line(answer.error)}
        self._record("outcome", caller, command, said, number)

    async def close(self) -> None:
        """Write the queued records, as far as possible within `LONGEST_WAIT_S`, and close the file."""
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        await asyncio.to_thread(self._thread.join, LONGEST_WAIT_S)

    def _record(
        self, record: str, caller: Caller, command: CommandRequest, said: Mapping[str, Any], number: int | None = None
    ) -> tuple[int, Future[None]]:
        number = next(self._numbers) if number is None else number
        content = {
            "number": number,
            "who": caller.name,
            "role": caller.role.name.lower(),
            "door": caller.door,
            "drive": command.drive,
            "line": command.line,
            "verb": command.verb,
            "arguments": command.arguments,
            "options": command.options,
            "id": command.id,
            "arm": command.arm,
            **said,
        }
        hidden = command.lease if len(command.lease) >= _SHORTEST_KEY else ""
        written: Future[None] = Future()
        try:
            self._waiting.put_nowait((self._line(record, _kept(_said(content), hidden)), written))
        except queue.Full:
            self._count_lost(1, _SLOW)
            written.set_exception(TimeoutError())
        return number, written

    def _line(self, record: str, content: Mapping[str, Any]) -> bytes:
        begin = _said({"time": _utc(self._clock()), "record": record, "session": self._session})
        return json_text({**begin, **content}).encode(errors="replace") + b"\n"

    def _write_all(self) -> None:
        ended = False
        self._write([])
        while not ended:
            batch = [self._waiting.get()]
            with suppress(queue.Empty):
                while True:
                    batch.append(self._waiting.get_nowait())
            ended = None in batch
            # A command whose caller timed out was not sent, so its record is dropped.
            wanted = [each for each in batch if each is not None and each[1].set_running_or_notify_cancel()]
            if wanted:
                self._write(wanted)
        self._file.close()

    def _write(self, wanted: Sequence[tuple[bytes, Future[None]]]) -> None:
        error: OSError | None = None
        missing = self._lost
        gap = [self._line("gap", {"missing": missing})] if missing else []
        try:
            self._file.add([*gap, *(line for line, _ in wanted)])
        except OSError as failed:
            error = failed
            self._count_lost(len(wanted), failed.strerror or str(failed))
        else:
            if self._failing:
                self._say(f"{self._file.path}: commands are recorded again; {missing} records are missing")
            with self._counting:
                self._failing, self._lost = False, self._lost - missing
        for _, written in wanted:
            if error is None:
                written.set_result(None)
            else:
                written.set_exception(error)

    def _count_lost(self, records: int, reason: str) -> None:
        with self._counting:
            begins, self._failing = not self._failing, True
            self._lost += records
        if begins:
            self._say(f"{self._file.path}: {reason}; only stops are sent until it can be written")

    def _say(self, text: str) -> None:
        with suppress(RuntimeError):
            # The event loop may have ended already; then the message is lost.
            self._loop.call_soon_threadsafe(self._tell, text)


def _utc(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _said(content: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if value}


def _kept(value: Any, hidden: str, depth: int = 0) -> Any:
    """Return a value in a form fit for the audit: JSON types only, secrets masked, depth and length limited."""
    if depth > _DEEPEST:
        return "..."
    if isinstance(value, Mapping):
        return {
            _text(str(key), hidden): "***" if str(key).casefold() in _SECRET else _kept(each, hidden, depth + 1)
            for key, each in islice(value.items(), _MOST_ITEMS)
        }
    if isinstance(value, list | tuple | set | frozenset):
        return [_kept(each, hidden, depth + 1) for each in islice(value, _MOST_ITEMS)]
    if isinstance(value, Enum):
        return _kept(value.value, hidden, depth + 1)
    if value is None or (isinstance(value, int) and abs(value) < _LARGEST):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else str(value)
    if isinstance(value, Decimal):
        return value if value.is_finite() and len(str(value)) <= _LONGEST_NUMBER else _text(str(value), hidden)
    return _text(value if isinstance(value, str) else shortened(value), hidden)


def _text(text: str, hidden: str) -> str:
    text = text.replace(hidden, "***") if hidden else text
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."
