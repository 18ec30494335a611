"""Telegrams that carry tasks and control words to one drive."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, UnexpectedReplyError
from drivecomm.protocol import Pause, Tell, cached, unless_refused
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
"""Time within which a reply arrives: the drive takes up to 20 ms (A-9), and an adapter adds a delay."""
_REPORT = frozenset({"report"})
_NOT_YET = frozenset({"pending", "ak", "parameter", "index"})
"""Differences of replies that a drive sends while it works on a task; they may answer the one before (C-15)."""
_REPEATS, _AGAIN_S = 50, 0.010
"""Limit and interval of repetitions, half a second or more in total.

No drive sends this many change reports in a row.
"""


class UssFrames:
    """Telegrams to one drive. read: reads a parameter as a word."""

    keeps_start = False

    def __init__(self, address: int, options: UssOptions, read: Callable[[str], Exchange[Reading]]) -> None:
        self.request = cached(partial(Request, address=address))
        self.needs_words = options.running_needs_control
        self._options, self._codec = options, UssCodec(options)
        self._spm: bool | None = None
        self._read = read

    def block(self, word: int, reference: int, /, **task: Any) -> Request:
        """Return a telegram with these words, and with this task if one is given."""
        options = self._options
        if task and not options.pkw_words:
            raise NotSupported("this drive's telegrams have no PKW area, so its parameters cannot be reached")
        fields = task or ({"ak": 0, "pnu": 0} if options.pkw_words else {})
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))

    def answer(self, ask: Ask) -> Exchange[Reply]:
        """Return the reply to a request; repeat the request in another form if the reply may be an echo.

        Request and reply can be equal if the process words are missing or zero. Then the task gets words that it does
        not need and that drives ignore (C-38, C-39). If it has no such words, a special telegram is sent first, which
        no drive answers (A-4), so that its return reveals an echo.
        """
        message: Any = ask.message
        task = TASKS["request"][message.ak or 0]
        if (message.ak or 0) not in task.answers or ask.command:
            return (yield from self._acknowledging(ask))
        reply = yield from self._acknowledging(replace(ask, mirrored=True))
        if reply.value or reply.status_word != message.control_word:
            # The usual case: no echo.
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
        """Send a request until its reply comes (C-15).

        Change reports before the reply are acknowledged by their toggle bit (C-16, C-17). A new command is not repeated
        here: the link decides how often it may be sent. Raises UnexpectedReplyError.
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
            # The process words of a report are valid, and the next telegram acknowledges it.
            if not differs or (differs == "report" and not message.ak):
                return reply
            if differs != "report":
                yield Pause(seconds=_AGAIN_S)
        raise UnexpectedReplyError(
            f"the drive does not carry out the task, however often it is repeated: its last reply differs in {differs}"
        )

    def shown(self, word: str) -> Exchange[int | None]:
        """Read the reference that the drive received from the bus; None if unknown, and for any other word."""
        address = self._options.reference_parameter if word == "reference" and self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(address))) if address else None
        return None if reading is None else int(reading.raw)
