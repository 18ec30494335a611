"""Commanding drives whose every telegram carries a control word and a reference, and every reply their status.

A reply shows the drive as it was before the command of its request took effect (VLT 5000 Design Guide p. 95, NORD BU
0050 p. 37), so nothing is concluded from it about that command. What builds on a command that was given before, such as
another reference, first asks whether the motor runs by it, and is refused where it does not: a start that is sent again
would start a motor that somebody has stopped.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import CommandTooOldError, StateError
from drivecomm.profiles.commander import taken_over
from drivecomm.profiles.profile import ONLY
from drivecomm.protocol import Ask

if TYPE_CHECKING:
    from drivecomm.profiles.profile import ControlProfile, Step, Words
    from drivecomm.protocol import Exchange, Message


class CommandMemory:
    """The last command to one drive, shared by all who speak to it on one bus.

    word: the control word that was commanded, 0 when there is none, or none that holds. idle: the same of a word that
    lets no motor run, which stays when it is forgotten: it may be sent again at any age. obeyed: whether a status has
    shown since that the drive does what the word says. reference: what goes with it, None until it was set here or read
    from the drive. functions: further bits that every command carries. watched: whether the drive's watchdog is known
    to be on, so that the command has to be repeated. owed: whether the word takes back a start that a tripped drive
    still keeps, and has not been sent yet.
    """

    def __init__(self) -> None:
        self.word = self.idle = self.functions = 0
        self.obeyed = self.watched = self.owed = False
        self.reference: int | None = None

    def forget(self) -> None:
        """Forget the control word; reference and functions stay as they were chosen, for the next start."""
        self.word, self.obeyed, self.owed = 0, False, False

    def watch(self, silence_s: float | None) -> None:
        """Take note whether the watchdog is on."""
        self.watched = silence_s is not None


class ProcessWords(ABC):
    """Speaks with one drive in words; what carries those of its control profile.

    A start is remembered only when the drive has answered it, a stop before it is sent. seen: the status word of the
    last reply. keeps_start: whether a start that a tripped drive has got starts the motor when the trip is reset, so
    that it is taken back.
    """

    keeps_start = False

    def __init__(self, memory: CommandMemory) -> None:
        self.memory = memory
        self.seen = 0

    @property
    @abstractmethod
    def profile(self) -> ControlProfile:
        """The control profile."""

    @abstractmethod
    def block(self, word: int, reference: int) -> Message:
        """Return the telegram that carries these words and nothing else."""

    def shown_word(self) -> Exchange[int | None]:
        """Read the control word that the drive got last; None where it shows none."""
        yield from ()
        return None

    def shown_reference(self) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus; None where it shows none."""
        yield from ()
        return None

    def ask(self, *, attempts: int | None = None) -> Exchange[Any]:
        """Ask for the status by words that command nothing."""
        return self.noticed((yield Ask(message=self.block(0, 0), attempts=attempts, nameless=True)))

    def command(
        self, word: int, *, repeated: bool = False, attempts: int | None = None, acts: bool = True, urgent: bool = False
    ) -> Exchange[Any]:
        """Send a control word with the reference that is set; its reply says nothing of what it answers.

        repeated: it builds on the one that was commanded. Raises CommandTooOldError if that is old, and lets run.
        """
        age = self.age_of(word, repeated=repeated)
        message = self.block(word, (self.memory.reference or 0) if age else 0)
        ask = Ask(message=message, attempts=attempts, acts=acts, nameless=True, urgent=urgent, command=age)
        return self.noticed((yield ask))

    def age_of(self, word: int, *, repeated: bool) -> Literal["", "new", "repeated"]:
        """Return what a control word is to the drive's watchdog; one that lets no motor run may be sent at any age."""
        if not word or not self.profile.commands(word):
            return ""
        return "repeated" if repeated and self.profile.lets_run(word) else "new"

    def remember(self, word: int) -> None:
        """Take note of a control word that is commanded."""
        memory = self.memory
        memory.word, memory.obeyed, memory.owed = word, False, False
        memory.idle = 0 if self.profile.lets_run(word) else word

    def noticed(self, reply: Any) -> Any:
        """Take note of a status: what it contradicts after it was obeyed, or after a trip, holds no longer."""
        memory, self.seen = self.memory, reply.status_word or 0
        word = memory.word or memory.idle
        if not word:
            return reply
        runs = self.profile.lets_run(word)
        if runs and self.says("fault"):
            self.remember(self.profile.reset[0].word | memory.functions if self.keeps_start else 0)
            memory.obeyed = memory.owed = self.keeps_start
        elif self.says("running") is runs:
            memory.obeyed = True
        elif memory.obeyed:
            self.remember(0)
        return reply

    def says(self, bit: str) -> bool:
        """Whether the status that was seen last says so."""
        return bool(self.profile.says(bit, {ONLY: self.seen}))

    @property
    def runs(self) -> bool:
        """Whether the word that was commanded lets the motor run."""
        return self.profile.lets_run(self.memory.word)

    def look(self) -> Exchange[Words]:
        """Return the status word."""
        yield from self.ask()
        return {ONLY: self.seen}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word of the profile. Of a reset only the first one is remembered: what then contradicts it holds."""
        word, runs = step.word | self.memory.functions, self.profile.lets_run(step.word)
        if not runs and step not in self.profile.reset[1:]:
            self.remember(word)
        yield from self.command(word, attempts=None if step.repeats else 1, urgent=urgent)
        if runs:
            self.remember(word)
        return {ONLY: self.seen}

    def again(self, step: Step) -> Exchange[Words]:
        """Send a step once more where it may be, which keeps what it says in force; look otherwise."""
        return self.send(step, urgent=False) if step.repeats else self.look()

    def status(self) -> Exchange[Any]:
        """Return the reply to a question for the status; what was commanded is then repeated for a watchdog."""
        reply, memory = (yield from self.ask()), self.memory
        if (memory.watched or memory.owed) and (yield from self.holds()):
            # Too old: what was asked for is the status all the same.
            with suppress(CommandTooOldError):
                reply = yield from self.command(memory.word, repeated=True, acts=False)
                memory.owed = False
        return reply

    def holds(self) -> Exchange[bool]:
        """Whether the word that was commanded may be sent again: none that would start the motor.

        A motor that another master has stopped shows as running until it stands, so a drive that can is asked which
        word it got last. One that shows none, or an invalid one, says nothing by that.
        """
        if not self.runs:
            return bool(self.memory.word)
        if not self.says("running"):
            return False
        shown = yield from self.shown_word()
        if shown and self.profile.commands(shown) and shown != self.memory.word:
            self.remember(0)
        return self.runs

    def must_hold(self, verb: str) -> Exchange[None]:
        """Raise StateError where to send the last command again, with something added, would start the motor."""
        if not (yield from self.holds()):
            raise StateError(
                f"{verb} would send the start again to a motor that does not run, or that somebody else commands by "
                "now; start it anew, or stop it first"
            )

    def set_reference(self, steps: int) -> Exchange[None]:
        """Send the reference with the control word that holds, and remember it; a drive that stands gets a stop word.

        Raises StateError for a motor that runs by a command of somebody else: no word could be sent with the reference
        that changes nothing else.
        """
        memory = self.memory
        yield from self.ask()
        if not memory.word:
            if self.says("running"):
                raise StateError(
                    "the motor runs by a command that this program did not give, and a reference cannot be sent "
                    "without a command; start it from here, too, and then set the reference"
                )
            self.remember(self.profile.reset[0].word | memory.functions)
        yield from self.must_hold("set_reference")
        before, memory.reference = memory.reference, steps
        try:
            yield from self.command(memory.word, repeated=True)
        except CommandTooOldError:
            memory.reference = before
            raise

    def take_over_reference(self) -> Exchange[None]:
        """Take the reference that the drive shows for one that was not set here. Raises StateError without one."""
        if self.memory.reference is None:
            self.memory.reference = taken_over((yield from self.shown_reference()))

    def release(self) -> Exchange[None]:
        """Repeat nothing any more: the drive keeps its last command until its watchdog acts. Sends nothing."""
        self.remember(0)
        yield from ()
