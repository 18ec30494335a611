"""Priority of commands on a line: the rules by which a stop wins, stated only here.

1. Each drive of a bus has one memory of its last command: every object that commands the drive writes into it
   (`Protocol.memory`).
2. A stop cancels every command for its drive that was called before it: the parts that were not sent by then are not
   sent any more, and raise CommandCancelledError. A stop of all drives cancels the commands for each of them; a stop of
   one drive cancels commands to all drives, which would reach it too.
3. A stop interrupts every call that waits on the line and does not stop anything itself. Such a call ends with
   OvertakenError: immediately if the drive should have begun to answer already, otherwise at the time when it should
   (`Link`).
4. The last command is forgotten when a stop is called, again when the stop is sent, and whenever the drive or the line
   was away. A package forgets a run command as soon as a status says that the motor does not run.
5. A run command is sent again only by exchanges that are meant to repeat it, right after a status in the same exchange
   which says that the motor runs; and not if it is older than the drive's watchdog time, which the link checks when it
   sends the command (`Ask.command`). If no watchdog is known to be on, nothing is repeated at all.
6. A command that this program did not give itself is never sent.
7. Reading carries no command, and a verb that is refused leaves nothing behind.
8. A caller may check a command again when its turn on the line has come, however long that took: if this check raises,
   the first telegram that acts is not sent, and the caller gets the error (`CommandCall.check`).
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Memory

EVERYBODY = "*"
"""Address of all drives of a protocol, in names such as "vabus:*"."""


class CommandHistory:
    """Commands of one bus: the last command of each drive, and the calls that a stop has cancelled.

    Threads use this class without a lock. If two stops are counted at the same moment, one count may be lost, but
    either stop cancels the earlier commands.
    """

    def __init__(self) -> None:
        self._stops: Counter[str] = Counter()
        self._memories: dict[str, Memory] = {}

    def memory(self, name: str, new: Callable[[], Memory]) -> Memory:
        """Return the memory of a drive's commands; all objects of this drive share it."""
        return self._memories.get(name) or self._memories.setdefault(name, new())

    def called(self, name: str, check: Callable[[], None] | None = None) -> CommandCall:
        """Register a call that commands a drive, or all drives of a protocol.

        check: called right before sending; raises if the command must not be sent any more.
        """
        return CommandCall(self, name, self._stops_for(name), check)

    def stop_called(self, name: str) -> None:
        """Cancel the earlier calls for a drive, or for all drives of a protocol, and forget their commands."""
        self._stops[name.partition(":")[0]] += 1
        self._stops[name] += 1
        self.forget(name)

    def forget(self, name: str) -> None:
        """Forget the commands of a drive, or of all drives of a protocol."""
        protocol, _, address = name.partition(":")
        for drive, memory in list(self._memories.items()):
            if drive == name or (address == EVERYBODY and drive.partition(":")[0] == protocol):
                memory.forget()

    def watch(self, name: str, silence_s: float | None) -> None:
        """Record the time that a drive's watchdog waits for its master; None if the watchdog is off or unknown."""
        memory = self._memories.get(name)
        if memory is not None:
            memory.watch(silence_s)

    def _stops_for(self, name: str) -> int:
        protocol, _, address = name.partition(":")
        if address == EVERYBODY:
            return self._stops[protocol]
        return self._stops[name] + self._stops[f"{protocol}:{EVERYBODY}"]


class CommandCall:
    """A call that commands a drive and that a later stop cancels."""

    __slots__ = ("_before", "_check", "_commands", "_name")

    def __init__(
        self, commands: CommandHistory, name: str, before: int, check: Callable[[], None] | None = None
    ) -> None:
        self._commands = commands
        self._name = name
        self._before = before
        self._check = check

    @property
    def cancelled(self) -> bool:
        """Whether a stop has been called since, so that the command must not be sent."""
        return self._commands._stops_for(self._name) != self._before  # noqa: SLF001 - two halves of one thing

    @property
    def in_doubt(self) -> bool:
        """Whether a stop or the caller's own check may forbid the next telegram."""
        return self._check is not None or self.cancelled

    def check(self, *, acts: bool) -> None:
        """Run the caller's own check, which raises if the command must not be sent.

        acts: whether the next telegram makes the drive do something. The check is not run again after such a telegram,
        because a command that has begun is not broken off.
        """
        if self._check is not None:
            self._check()
            if acts:
                self._check = None
