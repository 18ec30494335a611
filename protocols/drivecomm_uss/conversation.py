"""Tasks and control words to one drive, and what its replies tell of its status; what carries its control profile."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import CommandTooOldError, NotSupported
from drivecomm.profiles import ONLY
from drivecomm.protocol import Ask, kept
from drivecomm_uss.memory import profile
from drivecomm_uss.messages import Request

if TYPE_CHECKING:
    from drivecomm.profiles import Step, Words
    from drivecomm.protocol import Exchange
    from drivecomm_uss.memory import UssMemory
    from drivecomm_uss.messages import Reply
    from drivecomm_uss.options import UssOptions


class Conversation:
    """Speaks with one drive. Each reply shows it as it was before the command of its request took effect."""

    def __init__(self, address: int, options: UssOptions, memory: UssMemory) -> None:
        self.memory = memory
        self.request = kept(partial(Request, address=address))
        self._options = options

    def ask(self, *, acts: bool = False, attempts: int | None = None, **task: Any) -> Exchange[Reply]:
        """Send a task with process words that command nothing, or with those that hold where the drive needs them."""
        memory = self.memory
        held = (memory.word or memory.idle) if self._options.running_needs_control else 0
        ask = Ask(message=self._message(held, **task), acts=acts, attempts=attempts, nameless=not task)
        try:
            reply: Reply = yield replace(ask, command=_command_of(held, repeated=True))
        except CommandTooOldError:
            memory.command(0)
            reply = yield replace(ask, message=self._message(0, **task))
        memory.see(reply.status_word or 0)
        return reply

    def command(
        self, word: int, *, attempts: int | None = None, urgent: bool = False, repeated: bool = False
    ) -> Exchange[Reply]:
        """Send a control word with the reference that is set. repeated: it was sent before, and still holds."""
        ask = Ask(message=self._message(word), acts=True, attempts=attempts, nameless=True, urgent=urgent)
        reply: Reply = yield replace(ask, command=_command_of(word, repeated=repeated))
        self.memory.see(reply.status_word or 0)
        return reply

    def look(self) -> Exchange[Words]:
        """Return the status word."""
        return {ONLY: (yield from self.ask()).status_word or 0}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a control word; what holds from then on is remembered, a start when it was answered."""
        if step.repeats:
            self.memory.command(step.word)
        reply = yield from self.command(step.word, attempts=None if step.repeats else 1, urgent=urgent)
        if profile().lets_run(step.word):
            self.memory.command(step.word)
        return {ONLY: reply.status_word or 0}

    def again(self, step: Step) -> Exchange[Words]:
        """Send a step once more where it may be, which keeps what it says in force; look otherwise."""
        return self.send(step, urgent=False) if step.repeats else self.look()

    def _message(self, word: int, **task: Any) -> Request:
        options = self._options
        if task and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        fields = task or ({"ak": 0, "pnu": 0} if options.pkw_words else {})
        reference = (self.memory.reference or 0) if word and profile().commands(word) else 0
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))


def _command_of(word: int, *, repeated: bool) -> Literal["", "new", "repeated"]:
    if not word or not profile().commands(word):
        return ""
    return "repeated" if repeated and profile().lets_run(word) else "new"
