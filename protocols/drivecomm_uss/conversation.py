"""Tasks and control words to one drive, and what its replies tell of its status."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import CommandTooOldError, NotSupported
from drivecomm.protocol import Ask, Pause, Tell, kept, unless_refused
from drivecomm_uss.messages import Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.tasks import TASKS, profile
from drivecomm_uss.telegrams import UssCodec

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles import CommandMemory, ControlProfile
    from drivecomm.protocol import Exchange, Reading
    from drivecomm_uss.messages import Reply
    from drivecomm_uss.options import UssOptions


_PLACE = ("pnu", "page", "index", "parameter_set")
_MARK = 0x5A5A
_REPLY_S = 0.100
"""A reply has come by then: within 20 ms (A-9), and through the adapter."""
_REPORTS = 16
"""More parameter change reports in a row than a drive can have to tell."""


class Conversation(profiles.ProcessWords):
    """Speaks with one drive. read: reads a parameter, as a word."""

    def __init__(
        self, address: int, options: UssOptions, memory: CommandMemory, read: Callable[[str], Exchange[Reading]]
    ) -> None:
        super().__init__(memory)
        self.request = kept(partial(Request, address=address))
        self._options, self._codec = options, UssCodec(options)
        self._spm: bool | None = None
        self._last: dict[str, Any] = {}
        self._read = read

    @property
    def profile(self) -> ControlProfile:
        """The control profile."""
        return profile()

    def block(self, word: int, reference: int, **task: Any) -> Request:
        """Return a telegram with these words and this task, or with none."""
        options = self._options
        if task and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        fields = {"spm": self._spm, **(task or {"ak": 0, "pnu": 0})} if options.pkw_words else {}
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))

    def ask(self, *, acts: bool = False, attempts: int | None = None, **task: Any) -> Exchange[Reply]:
        """Send a task with process words that command nothing, or with those that hold where the drive needs them.

        Another task for the same parameter comes behind none: the reply to the one before would pass for its own.
        """
        if task and self._last not in ({}, task) and all(task.get(name) == self._last.get(name) for name in _PLACE):
            yield from self.ask(attempts=attempts)
        self._last = task
        memory, reference = self.memory, self.memory.reference or 0
        held = (memory.word or memory.idle) if self._options.running_needs_control else 0
        message = self.block(held, reference if held else 0, **task)
        ask = Ask(message=message, acts=acts, attempts=attempts, nameless=not task)
        try:
            reply = yield from self._answer(replace(ask, command=self.age_of(held, repeated=True)))
        except CommandTooOldError:
            self.remember(0)
            reply = yield from self._answer(replace(ask, message=self.block(0, 0, **task)))
        self.noticed(reply)
        return reply

    def _answer(self, ask: Ask) -> Exchange[Reply]:
        """Ask, and ask again where the reply could be an echo: with no process words, or zeros, both can be the same.

        Words that a task does not need make the difference, which drives do not look at (C-38, C-39); where there are
        none, a special telegram before it, which no drive answers (A-4), shows whether there is an echo.
        """
        message, task = ask.message, TASKS["request"][ask.message.ak or 0]
        if (message.ak or 0) not in task.answers:
            return (yield from self._acknowledging(ask))
        reply = yield from self._acknowledging(replace(ask, mirrored=True))
        if self._codec.encode(reply) != self._codec.encode(message):
            return reply
        if message.ak is not None and not task.carries:
            words = (_MARK,) * (1 if self._options.pkw_words == VARIABLE else self._options.pkw_words - 2)
            return (yield from self._acknowledging(replace(ask, message=replace(message, pwe=words))))
        yield Pause(seconds=_REPLY_S)
        yield Tell(message=self.request(special=True, data=""))
        return (yield from self._acknowledging(replace(ask, mirrored=True)))

    def _acknowledging(self, ask: Ask) -> Exchange[Reply]:
        """Ask, and acknowledge the parameter change reports that come instead by their toggle bit (C-16, C-17)."""
        for _ in range(_REPORTS):
            reply: Reply = yield replace(ask, besides=frozenset({"report"}))
            if not TASKS["reply"][reply.ak or 0].report:
                return reply
            self._spm = reply.spm
            ask = replace(ask, message=replace(ask.message, spm=self._spm))
        return (yield ask)

    def shown_reference(self) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus."""
        shown = self._options.reference_parameter if self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(shown))) if shown else None
        return None if reading is None else int(reading.raw)
