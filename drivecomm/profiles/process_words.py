"""Commanding drives whose every telegram carries a control word and a reference, and every reply their status.

A reply shows the drive as it was before the command of its request took effect (VLT 5000 Design Guide p. 95, NORD BU
0050 p. 37), so nothing is concluded from it about that command. What builds on a command that was given before, such as
another reference, first asks whether the motor runs by it, and is refused where it does not: a start that is sent again
would start a motor that somebody has stopped.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal, Protocol

from drivecomm.errors import CommandTooOldError, StateError
from drivecomm.profiles.commander import Commander, taken_over
from drivecomm.profiles.profile import ONLY
from drivecomm.protocol import Ask, DriveState, kept

if TYPE_CHECKING:
    from collections.abc import Callable

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


class WordTelegrams(Protocol):
    """What a protocol package frames for one drive.

    keeps_start: whether a start that a tripped drive has got starts the motor when the trip is reset, so that it is
    taken back. needs_words: whether a running one trips without its control word, so that questions carry it; of drives
    that obey every word: whether the look before a start is a stop word, so that its reply tells the status.
    """

    keeps_start: bool
    needs_words: bool

    def block(self, word: int, reference: int, /, **task: Any) -> Message:
        """Return the telegram that carries these words and this task, or no task."""

    def shown(self, word: Literal["control_word", "reference"]) -> Exchange[int | None]:  # noqa: ARG002 - a default
        """Read what the drive got last from the bus; None where it does not show it."""
        yield from ()
        return None


class ProcessWords:
    """Speaks with one drive in words. profile: returns those that command it, read by who commands only.

    answer: carries out a question where that takes more than to ask it. A start is remembered only when the drive has
    answered it, a stop before it is sent. seen: the last status word.
    """

    def __init__(
        self,
        profile: Callable[[], ControlProfile],
        frames: WordTelegrams,
        memory: CommandMemory,
        answer: Callable[[Ask], Exchange[Any]] | None = None,
    ) -> None:
        self._profile = profile
        self._answer = answer
        self._frames = frames
        self.memory = memory
        self.seen = 0
        self._question = kept(
            lambda acts, attempts, **task: Ask(
                message=frames.block(0, 0, **task), acts=acts, attempts=attempts, nameless=not task
            )
        )

    @property
    def profile(self) -> ControlProfile:
        """The control profile."""
        return self._profile()

    def ask(self, *, acts: bool = False, attempts: int | None = None, **task: Any) -> Exchange[Any]:
        """Send a task, or ask for the status, by words that command nothing or, where the drive needs them, hold."""
        held = (self.memory.word or self.memory.idle) if self._frames.needs_words else 0
        if held:
            try:
                return (yield from self.command(held, repeated=True, acts=acts, attempts=attempts, **task))
            except CommandTooOldError:
                self.remember(0)
        ask = self._question(acts, attempts, **task)
        return self.noticed((yield ask) if self._answer is None else (yield from self._answer(ask)))

    def command(
        self, word: int, *, repeated: bool = False, attempts: int | None = None, acts: bool = True,
        urgent: bool = False, **task: Any,
    ) -> Exchange[Any]:  # fmt: skip
        """Send a control word with the reference that is set; its reply says nothing of what it answers.

        repeated: it builds on the one that was commanded. Raises CommandTooOldError if that is old, and lets run.
        """
        age: Literal["", "new", "repeated"] = ""
        if word and self.profile.commands(word):
            age = "repeated" if repeated and self.profile.lets_run(word) else "new"
        message = self._frames.block(word, (self.memory.reference or 0) if age else 0, **task)
        ask = Ask(message=message, attempts=attempts, acts=acts, nameless=not task, urgent=urgent, command=age)
        return self.noticed((yield ask) if self._answer is None else (yield from self._answer(ask)))

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
            self.remember(self.profile.reset[0].word | memory.functions if self._frames.keeps_start else 0)
            memory.obeyed = memory.owed = self._frames.keeps_start
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
        """Return the status word.

        Raises StateError where a drive that obeys every word has been given no reference, and shows none.
        """
        obeys_all = self._frames.needs_words and not self.profile.valid
        if obeys_all and not (self.memory.word or self.memory.idle):
            self.remember(self.profile.reset[0].word | self.memory.functions)
        yield from self.ask()
        if obeys_all:
            yield from self.take_over_reference()
        return {ONLY: self.seen}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word of the profile. Of a reset only the first one is remembered: what then contradicts it holds."""
        seen, word, runs = {ONLY: self.seen}, step.word | self.memory.functions, self.profile.lets_run(step.word)
        if step in self.profile.start[:-1] and self.runs and self.profile.status(seen).state is DriveState.RUNNING:
            # A motor that runs by a command from here is not stopped for the next one.
            return seen
        if not runs and step not in self.profile.reset[1:]:
            self.remember(word)
        yield from self.command(word, attempts=None if step.repeats else 1, urgent=urgent)
        if runs:
            self.remember(word)
        return {ONLY: self.seen}

    def commander(self, profile: ControlProfile | None = None, **how: Any) -> Commander:
        """Return who commands the drive, by this profile instead of its own. how: as of `Commander`."""
        return Commander(profile or self.profile, self, again=self.again, **how)

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
        shown = yield from self._frames.shown("control_word")
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
                percent = self.profile.percent_of(steps)
                anew = f"start() and set_reference(percent={float(percent):.4g})"
                raise StateError(
                    "the running command came from another program, and this drive takes a reference only with a "
                    f"command; give the new speed with the start: {anew}",
                    says=anew,
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
            self.memory.reference = taken_over((yield from self._frames.shown("reference")))

    def release(self) -> Exchange[None]:
        """Repeat nothing any more: the drive keeps its last command until its watchdog acts. Sends nothing."""
        self.remember(0)
        yield from ()
