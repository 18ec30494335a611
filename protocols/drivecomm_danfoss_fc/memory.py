"""What a master remembers of one drive: the control word and the reference that it was commanded last."""

from __future__ import annotations

from drivecomm import profiles
from drivecomm_danfoss_fc import words


class DanfossFcMemory:
    """The last command to one drive, shared by all who speak to it on one bus.

    word: the control word that was commanded, 0 when there is none, or none that holds. obeyed: whether a status has
    shown since that the drive does what the word says. reference: PCD2 for it. reference_known: False until it was set
    here or read from the drive. functions: the bits for preset, ramp, relays and set-up that every command carries.
    watched: whether the drive's control word timeout is known to be on, so that the command has to be repeated. owed:
    whether the word takes back a start that the drive still keeps, and has not been sent yet.
    """

    def __init__(self) -> None:
        self.word = words.IGNORED
        self.obeyed = False
        self.reference = 0
        self.reference_known = False
        self.functions = 0
        self.watched = False
        self.owed = False

    def forget(self) -> None:
        """Forget the control word; reference and functions stay as they were chosen, for the next start."""
        self.command(words.IGNORED)

    def watch(self, silence_s: float | None) -> None:
        """Take note whether the control word timeout is on."""
        self.watched = silence_s is not None

    def command(self, word: int) -> None:
        """Take note of a control word that is commanded."""
        self.word, self.obeyed, self.owed = word, False, False

    def see(self, status: int, *, profidrive: bool) -> None:
        """Take note of a status word: what it contradicts holds no longer.

        A reply shows the drive before the command of the same request took effect (VLT 5000 Design Guide p. 95), so a
        command is contradicted only by a status that comes after one that showed it obeyed.
        """
        if not self.word:
            return
        profile = words.profile(profidrive=profidrive)
        runs = profile.lets_run(self.word)
        if runs and profile.says("fault", {profiles.ONLY: status}):
            # Whoever resets it would start the motor, as long as the drive keeps the word that made it run.
            self.command(profile.reset[0].word | self.functions)
            self.obeyed = self.owed = True
        elif words.has(status, words.RUNNING) == runs:
            self.obeyed = True
        elif self.obeyed:
            self.command(words.IGNORED)
