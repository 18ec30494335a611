"""Exchanges with one VABus drive: enquiry, select, error register, and the words of its control profile.

Short description sections 6.1, 6.2, 6.5; timing and error handling Agile VABus manual p. 26-33.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import RefusedError, ReplyError, UnexpectedReplyError
from drivecomm.protocol import Ask, Exchange, Tell, cached, code_texts
from drivecomm_vabus.errorcodes import DATASETS_DIFFER, ERROR_REGISTER, LINE_FAULTS, UNKNOWN_PARAMETER
from drivecomm_vabus.telegrams import BROADCAST, Enquiry, Eot, Nak, Select, Value, number_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles import ControlStep, Words
    from drivecomm.protocol import Message
    from drivecomm_vabus.options import VabusOptions
    from drivecomm_vabus.telegrams import ValueType

CONTROL_WORD, STATE_WORD, LOCAL_REMOTE, CURRENT_FAULT = 410, 411, 412, 260

_CLOSING = Tell(message=Eot(), pause_s=0.0)

# Time for the two-byte answer to a stop that was sent without waiting for it, including the drive's delay.
_ANSWERED_S = 0.05


profile = partial(profiles.control_profile, "drivecom")
"""The control profile; its file is read only when a drive is commanded, not when a parameter is read."""


@dataclass(slots=True, kw_only=True)
class VabusMemory:
    """State that a master keeps for one drive, shared by all callers that command it on one bus.

    maybe_locked: the drive may refuse every write until its error register is read. unanswered: a request was not
    answered, so the next NAK may be meant for it. runs: the last confirmed control word is 000F of a start, so that
    every control word of a stop only clears bits.
    """

    maybe_locked: bool = False
    unanswered: bool = False
    runs: bool = False

    def forget(self) -> None:
        """Forget that the drive runs. The write lock of the error register remains."""
        self.runs = False

    def watch(self, silence_s: float | None) -> None:
        """Do nothing, because every telegram to a drive feeds its watchdog."""


class VabusConversation:
    """Enquiries and selects to one drive, and selects to all drives at address 32.

    After a NAK the drive refuses every write until its error register is read, so the register is read after every NAK
    (short description section 6.5). If that failed, or if it is unknown whether a select was refused, the register is
    read before the next select. A NAK does not name the request that it refuses. The first NAK after an unanswered
    request may belong to that one, so the present request is repeated once before the NAK is accepted.
    """

    def __init__(self, address: int, options: VabusOptions, memory: VabusMemory) -> None:
        self._address = address
        self._place = {"address": address, "sys": options.sys}
        self._options = options
        self._memory = memory
        self._closes_values = options.trailing_eot is True
        self._enquiry = cached(
            lambda number, dataset: Ask(message=Enquiry(**self._place, dataset=dataset, parameter=number))
        )

    def enquire(self, number: int, dataset: int, name: str) -> Exchange[Value]:
        """Read the data characters of a parameter. Raises RefusedError."""
        return self._answer(self._enquiry(number, dataset), name)

    def number(self, number: int, type: ValueType, name: str, *, dataset: int = 0) -> Exchange[int]:
        """Read a number. Raises RefusedError, and UnexpectedReplyError for data that is not such a number."""
        reply = yield from self.enquire(number, dataset, name)
        try:
            return number_of(reply.data, type, lower_case_hex=self._options.lower_case_hex)
        except ValueError as error:
            raise UnexpectedReplyError(f"{name} is not of type {type}: {error}") from error

    def held(self, number: int, type: ValueType, name: str) -> Exchange[Mapping[int, int]]:
        """Read the values of a parameter by data set, under 0 if all are equal; empty if the drive lacks it."""
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
        """Read the state word."""
        return {profiles.SOLE_PLACE: (yield from self.number(STATE_WORD, "uint", "411, the state word"))}

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[Words | None]:
        """Write a control word of the profile; its answer does not contain the state."""
        yield from self.command(step.word, attempts=None if step.repeats else 1, urgent=urgent)
        return None

    def tell(self, word: int) -> Tell:
        """Return a telegram that writes the control word without waiting for an answer, even with a request open."""
        return Tell(message=self._select(CONTROL_WORD, 0, f"{word:04X}"), pause_s=_ANSWERED_S)

    def error_register(self) -> Exchange[int | None]:
        """Read the error register, which clears it and the write lock; None if the drive does not return it.

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
        """Read a parameter once; a NAK proves the drive as well as a value does."""
        reply = yield replace(self._enquiry(number, 0), attempts=1)
        if self._closes(reply):
            yield _CLOSING
        if not isinstance(reply, Value):
            yield from self.error_register()

    def _answer(self, ask: Ask, name: str) -> Exchange[Any]:
        """Return the reply if it is not a NAK. Raises RefusedError for a NAK."""
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
        """Whether an EOT of its own ends the exchange, rather than the one with which the next request begins."""
        return self._closes_values if isinstance(reply, Value) else bool(self._options.trailing_eot)

    def _select(self, number: int, dataset: int, data: str) -> Select:
        return Select(**self._place, dataset=dataset, parameter=number, data=data)


def _refused(parameter: str, code: int | None) -> RefusedError:
    if code is None:
        return RefusedError(parameter, None, "its error register could not be read")
    if code == 0:
        return RefusedError(parameter, None, "its error register was empty when it was read")
    return RefusedError(parameter, code, code_texts(__file__, "errors.toml").get(code, f"unlisted error {code}"))
