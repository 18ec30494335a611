"""The same command twice is carried out once: whoever asks again by the same id gets the first answer."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Mapping

    from drivecomm.server.callers import Caller
    from drivecomm.server.door import Answer, Command

REMEMBERED_S = 600.0
MOST = 10_000
"""So many answers are remembered of each caller at most; the oldest are forgotten first."""
_LONGEST_ID = 200


@dataclass(frozen=True, slots=True)
class _Once:
    asked: tuple[str, str, str, bytes]
    task: asyncio.Task[Answer]
    begun_s: float


class Repeats:
    """Remembers what commands have come to, for ten minutes. clock: one that nobody sets.

    Used within one event loop. A stop is not for it: each one acts.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._known: dict[tuple[str, str], OrderedDict[str, _Once]] = {}

    async def once(self, caller: Caller, command: Command, act: Callable[[], Coroutine[Any, Any, Answer]]) -> Answer:
        """Return what the command has come to; act: carries it out, which goes on although this wait is cancelled.

        What it raises of the errors of drivecomm is an answer, too. Raises UsageError for an id that this caller has
        used for something else.
        """
        if not command.id:
            return await act()
        if len(command.id) > _LONGEST_ID:
            raise UsageError(f"the id of a command has at most {_LONGEST_ID} characters")
        self._forget()
        of_caller = self._known.setdefault((caller.name, caller.door), OrderedDict())
        asked = (command.drive, command.line, command.verb, _digest(command.arguments))
        once = of_caller.get(command.id)
        if once is not None and once.asked != asked:
            raise UsageError(f"the id {command.id!r} was used for another command; give each command an id of its own")
        if once is None or _broken(once.task):
            of_caller.pop(command.id, None)
            once = of_caller[command.id] = _Once(asked, asyncio.create_task(act()), self._clock())
            once.task.add_done_callback(_without_frames)
            while len(of_caller) > MOST:
                of_caller.popitem(last=False)
        return await asyncio.shield(once.task)

    def _forget(self) -> None:
        before = self._clock() - REMEMBERED_S
        for caller, known in list(self._known.items()):
            while known and next(iter(known.values())).begun_s <= before:
                known.popitem(last=False)
            if not known:
                del self._known[caller]


def _digest(arguments: Mapping[str, Any]) -> bytes:
    """Return what stands for arguments, however long they are."""
    return sha256(repr(sorted(arguments.items())).encode(errors="backslashreplace")).digest()


def _without_frames(task: asyncio.Task[Answer]) -> None:
    """Let go of where the error of an answer came from: it would keep all that was at hand there for ten minutes."""
    if task.cancelled() or task.exception() is not None:
        return
    error: BaseException | None = task.result().error
    while error is not None:
        error.with_traceback(None)
        error = error.__cause__ or error.__context__


def _broken(task: asyncio.Task[Answer]) -> bool:
    """Whether a command has come to nothing by a mistake of the server's, which is no answer."""
    if not task.done():
        return False
    return task.cancelled() or not isinstance(task.exception(), DriveCommError | None)
