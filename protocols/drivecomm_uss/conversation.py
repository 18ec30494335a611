"""The telegrams that carry tasks and control words to one drive."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, UnexpectedReplyError
from drivecomm.protocol import Pause, Tell, kept, unless_refused
from drivecomm_uss.messages import Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.tasks import TASKS, mismatch
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
_NOT_YET = frozenset({"pending", "ak", "parameter", "index"})
"""What a drive answers while it works on a task, and may still answer to the one before (C-15)."""
_REPEATS, _AGAIN_S = 50, 0.010
"""For half a second at least; no drive has so many parameter change reports to tell in a row."""


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
        """Ask until the reply comes (C-15), and acknowledge change reports before it by their toggle bit (C-16, C-17).

        A new command is not repeated here: how often it may go out is the link's affair. Raises UnexpectedReplyError.
        """
        message: Any = ask.message
        besides = _REPORT if ask.command == "new" else _REPORT | _NOT_YET
        for _ in range(_REPEATS):
            if self._spm is not None:
                ask = replace(ask, message=replace(message, spm=self._spm))
            reply: Reply = yield replace(ask, besides=besides)
            differs = mismatch(message, reply)
            if differs == "report":
                self._spm = reply.spm
            # The process words of a report are good, and the next telegram acknowledges.
            if not differs or (differs == "report" and not message.ak):
                return reply
            if differs != "report":
                yield Pause(seconds=_AGAIN_S)
        raise UnexpectedReplyError(
            f"the drive does not carry out the task, however often it is repeated: its last reply differs in {differs}"
        )

    def shown(self, word: str) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus; it shows no control word."""
        address = self._options.reference_parameter if word == "reference" and self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(address))) if address else None
        return None if reading is None else int(reading.raw)
