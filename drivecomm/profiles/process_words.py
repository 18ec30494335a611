"""Commands to drives whose every telegram carries a control word and a reference, and every reply their status.

A reply shows the drive as it was before the command of its request took effect (VLT 5000 Design Guide p. 95, NORD BU
0050 p. 37), so that it says nothing about that command. An operation that builds on an earlier command, such as another
reference, first checks whether the motor runs by that command, and is refused if it does not. A start that is sent
again would start a motor that another program or a person has stopped.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal, Protocol

from drivecomm.errors import CommandTooOldError, StateError
from drivecomm.profiles.commander import Commander, signed_reference
from drivecomm.profiles.profile import SOLE_PLACE
from drivecomm.protocol import Ask, DriveState, cached

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.profile import ControlProfile, ControlStep, Words
    from drivecomm.protocol import Exchange, Message


class CommandMemory:
    """The last command to one drive, shared by all its users on one bus.

    word: the control word in force, 0 if there is none. idle: the same for a word that lets no motor run; it stays when
    the command is forgotten, since it may be sent again at any age. obeyed: whether a status has shown since then that
    the drive obeys the word. reference: the reference that goes with it, None until it was set here or read from the
    drive. functions: further bits that every command carries. watched: whether the drive's watchdog is known to be on,
    so that the command has to be repeated. owed: whether the word takes back a start that a tripped drive still keeps,
    and has not been sent yet.
    """

    def __init__(self) -> None:
        self.word = self.idle = self.functions = 0
        self.obeyed = self.watched = self.owed = False
        self.reference: int | None = None

    def forget(self) -> None:
        """Forget the control word; reference and functions stay for the next start."""
        self.word, self.obeyed, self.owed = 0, False, False

    def watch(self, silence_s: float | None) -> None:
        """Record whether the watchdog is on."""
        self.watched = silence_s is not None


class WordTelegrams(Protocol):
    """Telegrams for one drive, which a protocol package provides.

    keeps_start: whether a tripped drive keeps a start that it receives, and starts the motor when the trip is reset;
    the start is then taken back. needs_words: whether a running drive trips without its control word, so that read
    requests carry it. Of drives that obey every word: whether the look before a start is a stop word, whose reply shows
    the status.
    """

    keeps_start: bool
    needs_words: bool

    def block(self, word: int, reference: int, /, **task: Any) -> Message:
        """Return the telegram that carries these words, and this task if there is one."""

    def shown(self, word: Literal["control_word", "reference"]) -> Exchange[int | None]:  # noqa: ARG002 - default
        """Read the word that the drive last received from the bus; None if the drive does not show it."""
        yield from ()
        return None


class ProcessWords:
    """Conversation with one drive in control and status words.

    profile: returns the control profile of the drive; called only for commands. answer: carries out a request if that
    takes more than sending it. A start is remembered only after the drive has answered it, a stop before it is sent.
    seen: the last status word.
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
        self._question = cached(
            lambda acts, attempts, **task: Ask(
                message=frames.block(0, 0, **task), acts=acts, attempts=attempts, nameless=not task
            )
        )

    @property
    def profile(self) -> ControlProfile:
        """Control profile of the drive."""
        return self._profile()

    def ask(self, *, acts: bool = False, attempts: int | None = None, **task: Any) -> Exchange[Any]:
        """Send a task, or request the status, with no command or, if the drive needs it, the word in force."""
        held = (self.memory.word or self.memory.idle) if self._frames.needs_words else 0
        if held:
            try:
                return (yield from self.command(held, repeated=True, acts=acts, attempts=attempts, **task))
            except CommandTooOldError:
                self.remember(0)
        ask = self._question(acts, attempts, **task)
        return self.process_status((yield ask) if self._answer is None else (yield from self._answer(ask)))

    def command(
        self, word: int, *, repeated: bool = False, attempts: int | None = None, acts: bool = True,
        urgent: bool = False, **task: Any,
    ) -> Exchange[Any]:  # fmt: skip
        """Send a control word with the present reference.

        Without a task, the reply does not show which request it answers. repeated: whether the telegram builds on the
        last command. Raises CommandTooOldError if that command is too old and lets the motor run.
        """
        age: Literal["", "new", "repeated"] = ""
        if word and self.profile.commands(word):
            age = "repeated" if repeated and self.profile.lets_run(word) else "new"
        message = self._frames.block(word, (self.memory.reference or 0) if age else 0, **task)
        ask = Ask(message=message, attempts=attempts, acts=acts, nameless=not task, urgent=urgent, command=age)
        return self.process_status((yield ask) if self._answer is None else (yield from self._answer(ask)))

    def remember(self, word: int) -> None:
        """Set the control word that commands the drive from now on."""
        memory = self.memory
        memory.word, memory.obeyed, memory.owed = word, False, False
        memory.idle = 0 if self.profile.lets_run(word) else word

    def process_status(self, reply: Any) -> Any:
        """Process the status in a reply, which may end the command in force; return the reply.

        A trip ends a start. A command also ends if a status contradicts it after an earlier status has confirmed it.
        """
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
        """Return whether a statement, such as "running", is true in the last status."""
        return bool(self.profile.says(bit, {SOLE_PLACE: self.seen}))

    @property
    def runs(self) -> bool:
        """Whether the control word in force lets the motor run."""
        return self.profile.lets_run(self.memory.word)

    def look(self) -> Exchange[Words]:
        """Return the status word.

        Raises StateError for a drive that obeys every word, if no reference was set here and it shows none.
        """
        obeys_all = self._frames.needs_words and not self.profile.valid
        if obeys_all and not (self.memory.word or self.memory.idle):
            self.remember(self.profile.reset[0].word | self.memory.functions)
        yield from self.ask()
        if obeys_all:
            yield from self.take_over_reference()
        return {SOLE_PLACE: self.seen}

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[Words]:
        """Send a word of the profile.

        Of a reset, only the first word is remembered, so that a status that contradicts it later still ends it.
        """
        seen, word, runs = {SOLE_PLACE: self.seen}, step.word | self.memory.functions, self.profile.lets_run(step.word)
        if step in self.profile.start[:-1] and self.runs and self.profile.status(seen).state is DriveState.RUNNING:
            # A motor that already runs by a command from here is not stopped for the next start.
            return seen
        if not runs and step not in self.profile.reset[1:]:
            self.remember(word)
        yield from self.command(word, attempts=None if step.repeats else 1, urgent=urgent)
        if runs:
            self.remember(word)
        return {SOLE_PLACE: self.seen}

    def commander(self, profile: ControlProfile | None = None, **how: Any) -> Commander:
        """Return a commander of the drive, by this profile instead of its own.

        how: as in `Commander`.
        """
        return Commander(profile or self.profile, self, again=self.again, **how)

    def again(self, step: ControlStep) -> Exchange[Words]:
        """Return the status words after a step: repeat it if it may be repeated, which keeps it in force, or look."""
        return self.send(step, urgent=False) if step.repeats else self.look()

    def status(self) -> Exchange[Any]:
        """Return the reply to a status request; the command in force is repeated if a watchdog needs it."""
        reply, memory = (yield from self.ask()), self.memory
        if (memory.watched or memory.owed) and (yield from self.holds()):
            # Ignore a command that is too old: the caller wants the status, which is valid without it.
            with suppress(CommandTooOldError):
                reply = yield from self.command(memory.word, repeated=True, acts=False)
                memory.owed = False
        return reply

    def holds(self) -> Exchange[bool]:
        """Return whether the control word in force may be sent again, which is not so if it would start the motor.

        A motor that another master has stopped shows as running until it stands, so the last word from the bus is read
        from a drive that shows it. If the drive shows none, or an invalid one, this proves nothing.
        """
        if not self.runs:
            return bool(self.memory.word)
        if not self.says("running"):
            return False
        shown = yield from self._frames.shown("control_word")
        if shown and self.profile.commands(shown) and shown != self.memory.word:
            self.remember(0)
        return self.runs

    def check_repeatable(self, verb: str) -> Exchange[None]:
        """Raise StateError if repeating the last command, with an addition, would start the motor."""
        if not (yield from self.holds()):
            raise StateError(
                f"{verb} would send the start again to a motor that does not run, or that another program commands by "
                "now; start it again, or stop it first"
            )

    def set_reference(self, steps: int) -> Exchange[None]:
        """Send the reference with the control word in force, and remember it; a drive at standstill gets a stop word.

        Raises StateError for a motor that runs by a command of another program: any word that could be sent with the
        reference would change something else.
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
        yield from self.check_repeatable("set_reference")
        before, memory.reference = memory.reference, steps
        try:
            yield from self.command(memory.word, repeated=True)
        except CommandTooOldError:
            memory.reference = before
            raise

    def take_over_reference(self) -> Exchange[None]:
        """Adopt the reference that the drive shows if none was set here. Raises StateError if the drive shows none."""
        if self.memory.reference is None:
            self.memory.reference = signed_reference((yield from self._frames.shown("reference")))

    def release(self) -> Exchange[None]:
        """End the repetition of the command: the drive keeps it until its watchdog acts. Sends nothing."""
        self.remember(0)
        yield from ()
