"""Asking one VABus drive and telling it: enquiry, select, error register; what carries the words of its profile.

Short description sections 6.1, 6.2, 6.5; timing and error handling Agile VABus manual p. 26-33.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import RefusedError, ReplyError, UnexpectedReplyError
from drivecomm.protocol import Ask, Exchange, Tell, code_texts, kept
from drivecomm_vabus.errorcodes import DATASETS_DIFFER, ERROR_REGISTER, LINE_FAULTS, UNKNOWN_PARAMETER
from drivecomm_vabus.telegrams import BROADCAST, Enquiry, Eot, Nak, Select, Value, number_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles import Step, Words
    from drivecomm.protocol import Message
    from drivecomm_vabus.options import VabusOptions
    from drivecomm_vabus.telegrams import ValueType

CONTROL_WORD, STATE_WORD, LOCAL_REMOTE, CURRENT_FAULT = 410, 411, 412, 260

_CLOSING = Tell(message=Eot(), pause_s=0.0)

# In this time a drive has answered a stop that was told without waiting for its answer: two bytes after its delay.
_ANSWERED_S = 0.05


profile = partial(profiles.control_profile, "drivecom")
"""The control profile; read from its file by who commands a drive, and not by who reads a parameter."""


@dataclass(slots=True, kw_only=True)
class VabusMemory:
    """What a master remembers of one drive, shared by all who command it on a bus.

    maybe_locked: the drive may refuse every write until its error register is read. unanswered: a request was not
    answered, so that the next NAK may be meant for it. runs: the last control word that the drive confirmed is 000F of
    a start, so that any word of a stop only takes bits away from it.
    """

    maybe_locked: bool = False
    unanswered: bool = False
    runs: bool = False

    def forget(self) -> None:
        """What was commanded holds no longer. A lock of the register does not end by that."""
        self.runs = False

    def watch(self, silence_s: float | None) -> None:
        """Do nothing: whatever is sent to a drive feeds its watchdog."""


class Conversation:
    """Enquiries and selects to one drive, selects to all at address 32.

    After a NAK the drive refuses every write until its error register is read, so every NAK is followed by reading it
    (short description section 6.5). When that could not be done, or when it is open whether a select was refused, the
    register is read before the next select. A NAK does not say what it refuses: the first one after a request that was
    not answered may be that one's, so the question is put once more before it is believed.
    """

    def __init__(self, address: int, options: VabusOptions, memory: VabusMemory) -> None:
        self._address = address
        self._place = {"address": address, "sys": options.sys}
        self._options = options
        self._memory = memory
        self._closes_values = options.trailing_eot is True
        self._enquiry = kept(
            lambda number, dataset: Ask(message=Enquiry(**self._place, dataset=dataset, parameter=number))
        )

    def enquire(self, number: int, dataset: int, name: str) -> Exchange[Value]:
        """Ask for a parameter's value. Raises RefusedError."""
        return self._answer(self._enquiry(number, dataset), name)

    def number(self, number: int, type: ValueType, name: str, *, dataset: int = 0) -> Exchange[int]:
        """Ask for a number. Raises RefusedError, and UnexpectedReplyError for what is no such number."""
        reply = yield from self.enquire(number, dataset, name)
        try:
            return number_of(reply.data, type, lower_case_hex=self._options.lower_case_hex)
        except ValueError as error:
            raise UnexpectedReplyError(f"{name} is no {type}: {error}") from error

    def held(self, number: int, type: ValueType, name: str) -> Exchange[Mapping[int, int]]:
        """Ask what a parameter holds, by data set: under 0 where all are alike; empty where the drive has none such."""
        try:
            return {0: (yield from self.number(number, type, name))}
        except RefusedError as error:
            if error.code == UNKNOWN_PARAMETER:
                return {}
            if error.code != DATASETS_DIFFER:
                raise
        values = {}
        for dataset in range(1, 5):
            values[dataset] = yield from self.number(number, type, f"{name}[{dataset}]", dataset=dataset)
        return values

    def select(self, number: int, dataset: int, data: str, *, nameless: bool = True, **how: Any) -> Exchange[None]:
        """Write a parameter's data characters. Raises RefusedError. nameless and how: see `Ask`."""
        select = self._select(number, dataset, data)
        if number == CONTROL_WORD:
            self._memory.runs = False
        if self._address == BROADCAST:
            yield Tell(message=select)
            return
        if self._memory.maybe_locked:
            yield from self.error_register()
        yield from self._answer(Ask(message=select, acts=True, nameless=nameless, **how), str(number))

    def command(self, word: int, **how: Any) -> Exchange[None]:
        """Write the control word. how: see `Ask`."""
        return self.select(CONTROL_WORD, 0, f"{word:04X}", **how)

    def look(self) -> Exchange[Words]:
        """Return the state word."""
        return {profiles.ONLY: (yield from self.number(STATE_WORD, "uint", "411, the state word"))}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words | None]:
        """Write a control word of the profile; its answer does not tell the state."""
        yield from self.command(step.word, attempts=None if step.repeats else 1, urgent=urgent)
        return None

    def tell(self, word: int) -> Tell:
        """Return the command to write the control word at once, whatever else is open: no answer is waited for."""
        return Tell(message=self._select(CONTROL_WORD, 0, f"{word:04X}"), pause_s=_ANSWERED_S)

    def error_register(self) -> Exchange[int | None]:
        """Read the register, which clears it and the write lock; None when the drive does not tell.

        It belongs to the interface: system-bus node 0, data set 0. Decoded as uint, eight digits accepted.
        """
        self._memory.maybe_locked = True
        try:
            reply = yield Ask(message=Enquiry(address=self._address, parameter=ERROR_REGISTER))
        except ReplyError:
            return None
        if self._closes(reply):
            yield _CLOSING
        if not isinstance(reply, Value):
            return None
        self._memory.maybe_locked = False
        try:
            return number_of(reply.data[-4:], "uint", lower_case_hex=self._options.lower_case_hex)
        except ValueError:
            return None

    def probe(self, number: int) -> Exchange[None]:
        """Ask for a parameter once; a NAK is an answer as well as a value is."""
        reply = yield replace(self._enquiry(number, 0), attempts=1)
        if self._closes(reply):
            yield _CLOSING
        if not isinstance(reply, Value):
            yield from self.error_register()

    def _answer(self, ask: Ask, name: str) -> Exchange[Any]:
        """Return the reply that is no NAK. Raises RefusedError."""
        memory = self._memory
        for last in (False, True):
            try:
                reply = yield ask
            except (ReplyError, GeneratorExit):
                memory.unanswered = True
                memory.maybe_locked |= ask.acts
                raise
            if self._closes(reply):
                yield _CLOSING
            if not isinstance(reply, Nak):
                return reply
            doubtful = memory.unanswered and not ask.acts
            memory.unanswered &= ask.acts
            code = yield from self.error_register()
            if last or not (doubtful or code in LINE_FAULTS) or ask.attempts == 1:
                raise _refused(name, code)
        raise AssertionError  # pragma: no cover

    def _closes(self, reply: Message) -> bool:
        """Whether an exchange ends with an EOT of its own, and not with the one that the next request begins with."""
        return self._closes_values if isinstance(reply, Value) else bool(self._options.trailing_eot)

    def _select(self, number: int, dataset: int, data: str) -> Select:
        return Select(**self._place, dataset=dataset, parameter=number, data=data)


def _refused(parameter: str, code: int | None) -> RefusedError:
    if code is None:
        return RefusedError(parameter, None, "its error register could not be read")
    if code == 0:
        return RefusedError(parameter, None, "its error register was empty when it was read")
    return RefusedError(parameter, code, code_texts(__file__, "errors.toml").get(code, f"unlisted error {code}"))
