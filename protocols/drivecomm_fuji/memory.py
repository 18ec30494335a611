"""What a master remembers of one Fuji inverter."""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm_fuji.words import RUN


@dataclass(slots=True, kw_only=True)
class FujiMemory:
    """Shared by all who command the same inverter on a bus.

    word: S06 as it was last commanded here, for it carries terminals and run command together; FWD and REV only while
    they are confirmed. s01_beats: the S01 last written here by itself is not zero, which is worth a note and no more.
    """

    word: int = 0
    s01_beats: bool = False

    def forget(self) -> None:
        """Take FWD and REV away; terminals stay as they were set here."""
        self.word &= ~RUN
        self.s01_beats = False

    def watch(self, silence_s: float | None) -> None:
        """Do nothing: whatever is sent to an inverter feeds its watchdog."""
