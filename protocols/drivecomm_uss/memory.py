"""What a master remembers of one drive: the control word and the reference that it was commanded last."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles

if TYPE_CHECKING:
    from drivecomm.profiles import ControlProfile


def profile() -> ControlProfile:
    """Return the control profile; read from its file by who commands a drive, and not by who reads a parameter."""
    return profiles.control_profile("profidrive")


class UssMemory:
    """The last command to one drive, shared by all who speak to it on one bus.

    word: the control word that was commanded, 0 when there is none. idle: the word that stopped the motor, which may be
    sent again at any age. obeyed: whether a status has shown since that the drive does what the word says. reference:
    PZD2, None until it was set here or read from the drive. watched: whether the drive's telegram off time is on.
    """

    def __init__(self) -> None:
        self.word = self.idle = 0
        self.obeyed = self.watched = False
        self.reference: int | None = None

    def forget(self) -> None:
        """Forget the control word; the reference stays as it was chosen, for the next start."""
        self.word, self.obeyed = 0, False

    def watch(self, silence_s: float | None) -> None:
        """Take note whether the telegram off time is on."""
        self.watched = silence_s is not None

    def command(self, word: int) -> None:
        """Take note of a control word that is commanded."""
        self.word, self.obeyed, self.idle = word, False, 0 if profile().lets_run(word) else word

    def see(self, status: int) -> None:
        """Take note of a status word: what it contradicts after it was obeyed, or after a fault, holds no longer.

        A reply does not yet show the reaction to the command of its request (NORD p. 37).
        """
        word = self.word or self.idle
        if not word:
            return
        runs, seen = profile().lets_run(word), {profiles.ONLY: status}
        if runs and profile().says("fault", seen):
            self.command(0)
        elif profile().says("running", seen) is runs:
            self.obeyed = True
        elif self.obeyed:
            self.command(0)
