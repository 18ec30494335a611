"""Transport of steps and status for drives whose commands are registers."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.errors import CommandTooOldError
from drivecomm.profiles.register_command_tables import FAULT_PLACE
from drivecomm.protocol import unless_refused

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.profiles.control_table import ControlTable
    from drivecomm.profiles.profile import ControlStep, Words
    from drivecomm.profiles.register_command_memory import RegisterCommandMemory
    from drivecomm.protocol import Exchange


class RegisterTelegrams(Protocol):
    """Telegrams for one drive, which a protocol package provides."""

    def word(self, place: str, /) -> Exchange[int]:
        """Read one register or coil."""

    def words_of(self, places: Iterable[str], /) -> Exchange[dict[str, int]]:
        """Read registers or coils by name; the result may hold further ones."""

    def carry(self, step: ControlStep, **how: Any) -> Exchange[Words | None]:
        """Write one step of a command; return the status words that came with the reply, None if it had none.

        how: see `Ask`.
        """

    def fault_code(self) -> Exchange[int | None]:
        """Read the code of a fault; None if there is no fault."""


class RegisterCommandTransport:
    """A `WordTransport` for one drive's commands that repeats the command in force for the drive's watchdog.

    A start is remembered only after the drive has confirmed it. Any other step is remembered before it is sent.
    """

    def __init__(self, table: ControlTable, telegrams: RegisterTelegrams, memory: RegisterCommandMemory) -> None:
        self._table, self._telegrams, self._memory = table, telegrams, memory

    def look(self) -> Exchange[Words]:
        """Read the status registers, and the code of a fault if only the code shows a fault."""
        status = self._table.status
        if not status:
            # Nothing shows a fault, so assume one: then a reset is sent.
            return {FAULT_PLACE: 1}
        words = yield from self._telegrams.words_of(dict.fromkeys(condition.place for condition in status.values()))
        fault = status.get("fault")
        if fault is None:
            tripped = bool((yield from self._telegrams.fault_code()))
        else:
            tripped = fault.holds(words)
            if not tripped and self._table.code_tells:
                tripped = bool((yield from unless_refused(self._telegrams.fault_code())))
        return {**words, FAULT_PLACE: int(tripped)}

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[Words | None]:
        """Write one step of a command: once, unless it stops the motor.

        Returns the status words that came with the reply, None if it had none.
        """
        profile, fed_by = self._table.profile, self._table.fed_by
        runs = step in (*profile.start[-1:], *profile.start_reverse[-1:])
        if not runs:
            self._remember(step, runs=False)
        # Only a command that may be repeated has an age.
        command = {"command": "new"} if fed_by else {}
        seen = yield from self._telegrams.carry(
            step, attempts=None if urgent else 1, unseen=urgent, urgent=urgent, **command
        )
        if runs:
            self._remember(step, runs=True)
        return seen

    def feed(self, seen: Words) -> Exchange[None]:
        """Repeat the command in force if the watchdog is on and only commands restart its time.

        seen: the status words that were just read. A start is repeated only to a running motor. Nothing is repeated if
        the drive shows that another program has commanded it since.
        """
        memory, profile, shows = self._memory, self._table.profile, self._table.command_shown
        running = bool(profile.says("running", seen))
        memory.notice(running=running, fault=bool(profile.says("fault", seen)))
        step, fed_by = memory.held, self._table.fed_by
        if step is None or fed_by is None or not memory.watched or (memory.runs and not running):
            return
        shown = (yield from unless_refused(self._telegrams.word(shows))) if shows else None
        if shown is not None and shown & fed_by.mask in fed_by.values and shown != step.word:
            memory.forget()
        # A stop that was called meanwhile has also cleared the held step.
        if memory.held is step:
            # Ignore a command that is too old: the caller wants the status, which is valid without it.
            with suppress(CommandTooOldError):
                yield from self._telegrams.carry(step, attempts=1, command="repeated")

    def _remember(self, step: ControlStep, *, runs: bool) -> None:
        """Hold a step that feeds the watchdog; the edge of a reset must not be repeated."""
        fed_by = self._table.fed_by
        if fed_by is not None and step.place == fed_by.place and step not in self._table.profile.reset[:-1]:
            self._memory.hold(step, runs=runs)
        else:
            self._memory.forget()
