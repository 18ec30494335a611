"""Tasks and control words to one drive, and what its replies tell of its status."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import CommandTooOldError, NotSupported
from drivecomm.protocol import Ask, kept, unless_refused
from drivecomm_uss.messages import Request

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles import CommandMemory, ControlProfile
    from drivecomm.protocol import Exchange, Reading
    from drivecomm_uss.messages import Reply
    from drivecomm_uss.options import UssOptions


def profile() -> ControlProfile:
    """Return the control profile; read from its file by who commands a drive, and not by who reads a parameter."""
    return profiles.control_profile("profidrive")


class Conversation(profiles.ProcessWords):
    """Speaks with one drive. read: reads a parameter, as a word."""

    def __init__(
        self, address: int, options: UssOptions, memory: CommandMemory, read: Callable[[str], Exchange[Reading]]
    ) -> None:
        super().__init__(memory)
        self.request = kept(partial(Request, address=address))
        self._options = options
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
        fields = task or ({"ak": 0, "pnu": 0} if options.pkw_words else {})
        return self.request(**fields, **options.process_words(control_word=word, reference=reference))

    def ask(self, *, acts: bool = False, attempts: int | None = None, **task: Any) -> Exchange[Reply]:
        """Send a task with process words that command nothing, or with those that hold where the drive needs them."""
        memory, reference = self.memory, self.memory.reference or 0
        held = (memory.word or memory.idle) if self._options.running_needs_control else 0
        message = self.block(held, reference if held else 0, **task)
        ask = Ask(message=message, acts=acts, attempts=attempts, nameless=not task)
        try:
            reply: Reply = yield replace(ask, command=self.age_of(held, repeated=True))
        except CommandTooOldError:
            self.remember(0)
            reply = yield replace(ask, message=self.block(0, 0, **task))
        self.noticed(reply)
        return reply

    def shown_reference(self) -> Exchange[int | None]:
        """Read the reference that the drive has from the bus."""
        shown = self._options.reference_parameter if self._options.pkw_words else ""
        reading = (yield from unless_refused(self._read(shown))) if shown else None
        return None if reading is None else int(reading.raw)
