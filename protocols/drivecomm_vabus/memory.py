"""What a master remembers of one VABus drive."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True, kw_only=True)
class VabusMemory:
    """Shared by all who command the same drive on a bus.

    maybe_locked: the drive may refuse every write until its error register is read. unanswered: a request was not
    answered, so that the next NAK may be meant for it. runs: the last control word that the drive confirmed is 000F of
    a start, so that any word of a stop only takes bits away from it.
    """

    maybe_locked: bool = False
    unanswered: bool = False
    runs: bool = False

    def forget(self) -> None:
        """What was commanded holds no longer. A lock of the register does not end by that."""
        self.runs = False

    def watch(self, silence_s: float | None) -> None:
        """Do nothing: whatever is sent to a drive feeds its watchdog."""
