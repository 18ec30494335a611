"""Protection against repeated commands: a command with a known id is not sent again, but gets the first answer."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.line import result_of

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Mapping

    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandAnswer, CommandRequest

REMEMBERED_S = 600.0
MOST = 10_000
"""Number of answers that are remembered for each caller; the oldest are dropped first."""
_LONGEST_ID = 200


@dataclass(frozen=True, slots=True)
class _Once:
    asked: tuple[str, str, str, bytes]
    task: asyncio.Task[CommandAnswer]
    begun_s: float


class AnswerCache:
    """Answers to commands, remembered for ten minutes. clock: a monotonic clock.

    Used within one event loop. Not used for stops: each stop is carried out.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._known: dict[tuple[str, str], OrderedDict[str, _Once]] = {}

    async def once(
        self, caller: Caller, command: CommandRequest, act: Callable[[], Coroutine[Any, Any, CommandAnswer]]
    ) -> CommandAnswer:
        """Return the answer to a command; a repeated id gets the first answer.

        act: carries the command out, which continues if this wait is cancelled. Errors of drivecomm that it raises are
        remembered like answers. Raises UsageError for an id that this caller has used for another command.
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
        return await result_of(once.task)

    def _forget(self) -> None:
        before = self._clock() - REMEMBERED_S
        for caller, known in list(self._known.items()):
            while known and next(iter(known.values())).begun_s <= before:
                known.popitem(last=False)
            if not known:
                del self._known[caller]


def _digest(arguments: Mapping[str, Any]) -> bytes:
    """Return a hash of the arguments, which may be large."""
    return sha256(repr(sorted(arguments.items())).encode(errors="backslashreplace")).digest()


def _without_frames(task: asyncio.Task[CommandAnswer]) -> None:
    """Drop the traceback of an answer's error, which would keep its local variables in memory for ten minutes."""
    if task.cancelled() or task.exception() is not None:
        return
    error: BaseException | None = task.result().error
    while error is not None:
        error.with_traceback(None)
        error = error.__cause__ or error.__context__


def _broken(task: asyncio.Task[CommandAnswer]) -> bool:
    """Return whether a command ended without an answer: cancelled, or by a bug in the server."""
    if not task.done():
        return False
    return task.cancelled() or not isinstance(task.exception(), DriveCommError | None)
