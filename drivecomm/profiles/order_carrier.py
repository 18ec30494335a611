"""How the steps and the status of a drive whose commands are registers get there and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.profiles.order_tables import TRIPPED

if TYPE_CHECKING:
    from drivecomm.profiles.control_table import ControlTable
    from drivecomm.profiles.profile import Step, Words
    from drivecomm.protocol import Exchange


class RegisterTelegrams(Protocol):
    """What a protocol package frames for one drive."""

    def word(self, place: str, /) -> Exchange[int]:
        """Read one register, or coil."""

    def carry(self, step: Step, **how: Any) -> Exchange[None]:
        """Write one step of a command. how: see `Ask`."""

    def fault_code(self) -> Exchange[int | None]:
        """Read the code of a fault, None where there is none."""


class OrderCarrier:
    """Carries the steps of one drive's commands, as a `Carrier`."""

    def __init__(self, table: ControlTable, telegrams: RegisterTelegrams) -> None:
        self._table, self._telegrams = table, telegrams

    def look(self) -> Exchange[Words]:
        """Read the status registers, and the code of a fault where only that tells one."""
        status = self._table.status
        if not status:
            # Nothing tells, so that a reset is sent.
            return {TRIPPED: 1}
        words: dict[str, int] = {}
        for name in dict.fromkeys(condition.place for condition in status.values()):
            words[name] = yield from self._telegrams.word(name)
        fault = status.get("fault")
        tripped = bool((yield from self._telegrams.fault_code())) if fault is None else fault.holds(words)
        return {**words, TRIPPED: int(tripped)}

    def send(self, step: Step, *, urgent: bool) -> Exchange[None]:
        """Write one step of a command: once, unless it stops the motor."""
        yield from self._telegrams.carry(step, attempts=None if urgent else 1, urgent=urgent)

    def again(self, step: Step) -> Exchange[Words]:  # noqa: ARG002 - nothing is sent again
        """Read the status registers while something is awaited."""
        return self.look()
