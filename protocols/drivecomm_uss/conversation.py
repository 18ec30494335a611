"""The telegrams that carry tasks and control words to one drive."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported
from drivecomm.protocol import Pause, Tell, kept, unless_refused
from drivecomm_uss.messages import Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.tasks import TASKS
from drivecomm_uss.telegrams import UssCodec

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Ask, Exchange, Reading
    from drivecomm_uss.messages import Reply
    from drivecomm_uss.options import UssOptions


_MARK = 0x5A5A
_REPLY_S = 0.100
"""A reply has come by then: within 20 ms (A-9), and through the adapter."""
_REPORT = frozenset({"report"})
_REPORTS = 16
"""More parameter change reports in a row than a drive can have to tell."""


class Frames:
    """What goes to one drive. read: reads a parameter, as a word."""

    keeps_start = False

    def __init__(self, address: int, options: UssOptions, read: Callable[[str], Exchange[Reading]]) -> None:
        self.request = kept(partial(Request, address=address))
        self.needs_words = options.running_needs_control
        self._options, self._codec = options, UssCodec(options)
        self._spm: bool | None = None
        self._read = read

    def block(self, word: int, reference: int, /, **task: Any) -> Request:
        """Return a telegram with these words and this task, or with none."""
        options = self._options
        if task and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        fields = task or ({"ak": 0, "pnu": 0} if options.pkw_words else {})
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))

    def answer(self, ask: Ask) -> Exchange[Reply]:
        """Ask, and ask again where the reply could be an echo: with no process words, or zeros, both can be the same.

        Words that a task does not need make the difference, which drives do not look at (C-38, C-39); where there are
        none, a special telegram before it, which no drive answers (A-4), shows whether there is an echo.
        """
        message: Any = ask.message
        task = TASKS["request"][message.ak or 0]
        if (message.ak or 0) not in task.answers or ask.command:
            return (yield from self._acknowledging(ask))
        reply = yield from self._acknowledging(replace(ask, mirrored=True))
        if reply.value or reply.status_word != message.control_word:
            # As nearly always.
            return reply
        if self._codec.encode(replace(reply, spm=None)) != self._codec.encode(message):
            return reply
        if message.ak is not None and not task.carries:
            words = (_MARK,) * (1 if self._options.pkw_words == VARIABLE else self._options.pkw_words - 2)
            return (yield from self._acknowledging(replace(ask, message=replace(message, pwe=words))))
        yield Pause(seconds=_REPLY_S)
        yield Tell(message=self.request(special=True, data=""))
        return (yield from self._acknowledging(replace(ask, mirrored=True)))

    def _acknowledging(self, ask: Ask) -> Exchange[Reply]:
        """Ask, and acknowledge the parameter change reports that come instead by their toggle bit (C-16, C-17)."""
        message: Any = ask.message
        for _ in range(_REPORTS):
            if self._spm is not None:
                ask = replace(ask, message=replace(message, spm=self._spm))
            reply: Reply = yield replace(ask, besides=_REPORT)
            if not TASKS["reply"][reply.ak or 0].report:
                return reply
            self._spm = reply.spm
            if not message.ak:
                # The process words are good, and the next telegram acknowledges.
                return reply
        reply = yield ask
        return reply

    def shown(self, word: str) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus; it shows no control word."""
        address = self._options.reference_parameter if word == "reference" and self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(address))) if address else None
        return None if reading is None else int(reading.raw)
