"""Whose command counts on a line: the rules by which a stop wins, stated here and nowhere else.

1. There is one memory of what a drive was commanded last, for each drive and bus: whoever commands it, by whichever
   object, writes into the same (`Protocol.memory`).
2. A stop cancels every command for its drive that was called before it: what has not been sent by then is not sent any
   more, and raises CommandCancelledError. A stop of all drives cancels the commands for each of them, and a stop of one
   drive cancels commands to all drives, which would reach it too.
3. A stop interrupts whatever waits on the line and does not stop anything itself: that ends with OvertakenError, at
   once where the drive should have begun to answer already, otherwise by the time at which it should (`Link`).
4. What was commanded is forgotten when a stop is called, once more when the stop goes out, and whenever the drive or
   the line was away. A package forgets a run command as soon as a status says that the motor does not run.
5. A run command is sent again only by what is meant to repeat it, right after a status in the same exchange that says
   that the motor runs; and not when it is older than the drive's watchdog waits, which the link looks at when it goes
   out (`Ask.command`). Where no watchdog is known to be on, nothing is repeated at all.
6. What this program did not command itself is never sent.
7. Reading carries no command, and a verb that is refused leaves nothing behind.
8. Whoever calls a command may look at it once more when its turn on the line has come, however long that took: what
   their check raises is raised in place of sending the first telegram that acts (`CommandCall.check`).
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Memory

EVERYBODY = "*"
"""The address of all drives of a protocol, in names such as "vabus:*"."""


class Commands:
    """The commands of one bus: what its drives were commanded last, and which calls a stop has cancelled.

    Threads use it without a lock: of two stops that are counted at once one may be missed, and either cancels.
    """

    def __init__(self) -> None:
        self._stops: Counter[str] = Counter()
        self._memories: dict[str, Memory] = {}

    def memory(self, name: str, new: Callable[[], Memory]) -> Memory:
        """Return what is remembered of a drive, the same for all its objects."""
        return self._memories.get(name) or self._memories.setdefault(name, new())

    def called(self, name: str, check: Callable[[], None] | None = None) -> CommandCall:
        """Take note that a drive, or all drives of a protocol, are to be commanded.

        check: raises when that must not be sent any more; asked right before it is.
        """
        return CommandCall(self, name, self._stops_for(name), check)

    def stop_called(self, name: str) -> None:
        """Cancel what was called before for a drive, or all drives of a protocol, and forget what they were told."""
        self._stops[name.partition(":")[0]] += 1
        self._stops[name] += 1
        self.forget(name)

    def forget(self, name: str) -> None:
        """Forget what a drive, or all drives of a protocol, were commanded."""
        protocol, _, address = name.partition(":")
        for drive, memory in list(self._memories.items()):
            if drive == name or (address == EVERYBODY and drive.partition(":")[0] == protocol):
                memory.forget()

    def watch(self, name: str, silence_s: float | None) -> None:
        """Take note how long a drive's watchdog waits for its master."""
        memory = self._memories.get(name)
        if memory is not None:
            memory.watch(silence_s)

    def _stops_for(self, name: str) -> int:
        protocol, _, address = name.partition(":")
        if address == EVERYBODY:
            return self._stops[protocol]
        return self._stops[name] + self._stops[f"{protocol}:{EVERYBODY}"]


class CommandCall:
    """A call that commands a drive. cancelled: whether a stop has been called since."""

    __slots__ = ("_before", "_check", "_commands", "_name")

    def __init__(self, commands: Commands, name: str, before: int, check: Callable[[], None] | None = None) -> None:
        self._commands = commands
        self._name = name
        self._before = before
        self._check = check

    @property
    def cancelled(self) -> bool:
        """Whether it must not be sent any more."""
        return self._commands._stops_for(self._name) != self._before  # noqa: SLF001 - two halves of one thing

    @property
    def in_doubt(self) -> bool:
        """Whether something may keep its next telegram from being sent: a stop, or whoever has called it."""
        return self._check is not None or self.cancelled

    def check(self, *, acts: bool) -> None:
        """Raise what the check of whoever has called it raises.

        acts: the next telegram does something. What was begun is not broken off, so nothing is checked after it.
        """
        if self._check is not None:
            self._check()
            if acts:
                self._check = None
