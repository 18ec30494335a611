"""The conversation with one drive whose parameters are registers, telegram by telegram."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DeadlineError, NotSupported, OvertakenError, RefusedError, ReplyError
from drivecomm.profiles.registers import RegisterPlace
from drivecomm.protocol import Pause, Tell

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.profiles.dialect import Dialect
    from drivecomm.profiles.profile import ControlStep, Words
    from drivecomm.profiles.register_command_memory import RegisterCommandMemory
    from drivecomm.profiles.registers import RegisterParameter
    from drivecomm.protocol import Ask, Exchange

_BUSY_S, _POLL_S = 1.0, 0.05
"""Seconds for which a request to a busy drive is repeated, and between attempts; its line is blocked meanwhile."""
_TRIES = 3
"""Attempts for a request that was prepared in vain or arrived damaged."""


class RegisterConversation:
    """Reads and writes of one drive's registers, or writes to those of all drives at the broadcast address.

    is_there: whether the drive has sent a reply that cannot be the echo of an adapter.
    """

    def __init__(self, dialect: Dialect, memory: RegisterCommandMemory) -> None:
        self._dialect, self._memory = dialect, memory
        self.answers = dialect.address != dialect.broadcast_address
        self.is_there = False
        address = dialect.control.fault_code
        self._fault_code = dialect.target(address) if address else None

    def must_be_one(self) -> None:
        """Raise NotSupported at the broadcast address."""
        if not self.answers:
            raise NotSupported("that is for one drive; all drives of a series can only be stopped")

    def words(self, place: RegisterPlace, count: int, called: str) -> Exchange[tuple[int, ...]]:
        """Read registers from a place on.

        called: the name of the request in the error for a refusal.
        """
        self.must_be_one()
        reply = yield from self.send_request(self._dialect.reading(place, count), called, place)
        return self._dialect.words(reply, place)

    def word(self, place: str) -> Exchange[int]:
        """Read one register by the name of its place."""
        found = RegisterPlace.named(place)
        return (yield from self.words(found, 1, self._dialect.address_at(found)))[0]

    def words_of(self, places: Iterable[str]) -> Exchange[dict[str, int]]:
        """Read registers by the names of their places.

        If one telegram always reads all registers of a kind, their values are from the same moment.
        """
        told: dict[str, int] = {}
        for name in places:
            place = RegisterPlace.named(name)
            numbers = self._dialect.whole.get(place.kind)
            if numbers is None:
                told[name] = yield from self.word(name)
            elif name not in told:
                first = RegisterPlace(place.kind, numbers.start)
                words = yield from self.words(first, len(numbers), self._dialect.address_at(place))
                told |= {f"{place.kind}{number}": word for number, word in zip(numbers, words, strict=True)}
        return told

    def raw(self, wanted: RegisterParameter) -> Exchange[int | str]:
        """Read the raw value of a parameter from its registers."""
        count = 1 if wanted.wide else wanted.format.size
        return wanted.raw_of((yield from self.words(wanted.place, count, wanted.address)))

    def put(self, wanted: RegisterParameter, raw: int | str, goal: RegisterPlace, **how: Any) -> Exchange[None]:
        """Write a parameter.

        goal: the place to which the words go. how: see `Ask`.
        """
        return self.write(goal, wanted.words_for(raw, 0), wanted.address, **how)

    def write(self, place: RegisterPlace, words: Sequence[int], called: str, **how: Any) -> Exchange[None]:
        """Write registers from a place on; at the broadcast address, without a reply. Raises RefusedError.

        how: see `Ask`.
        """
        yield from self._send(place, words, called, **how)

    def carry(self, step: ControlStep, **how: Any) -> Exchange[Words | None]:
        """Write one step of a command. Returns the status words that came with the reply, None if it had none."""
        place = RegisterPlace.named(step.place)
        yield from self.write(place, (step.word,), self._dialect.address_at(place), **how)
        return None

    def fault_code(self) -> Exchange[int | None]:
        """Read the code of a fault; None if there is no fault."""
        raw = (yield from self.raw(self._fault_code)) if self._fault_code else 0
        return raw if isinstance(raw, int) and raw else None

    def send_request(self, ask: Ask, called: str, place: RegisterPlace | None = None) -> Exchange[Any]:
        """Send a request; repeat it while the drive is busy, or if it arrived damaged. Raises RefusedError.

        A stop is not repeated here while the drive is busy, but by its caller. called: the name of the request in the
        error. place: the place for which the request must be prepared.
        """
        dialect, waited, left = self._dialect, 0.0, ask.attempts or _TRIES
        while True:
            self._memory.unanswered = True
            reply = yield from self._prepared(ask, called, place)
            self._memory.unanswered = False
            self.is_there = self.is_there or not ask.mirrored
            code = dialect.refusal(reply)
            if code is None:
                return reply
            code, left = (yield from self._reason(code)), left - 1
            if left > 0 and code in dialect.damage:
                continue
            if code not in dialect.busy or ask.attempts is not None or ask.urgent or waited >= _BUSY_S:
                raise RefusedError(called, code, dialect.refusal_text(code, called))
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S

    def _reason(self, code: int) -> Exchange[int]:
        """Return the reason of a refusal from the drive's register for it, or `code` if that cannot be read."""
        place = self._dialect.reason
        if place is None:
            return code
        try:
            reply = yield self._dialect.reading(place, 1)
            return code if self._dialect.refusal(reply) is not None else self._dialect.words(reply, place)[0]
        except (OvertakenError, DeadlineError):
            raise
        except ReplyError:
            return code

    def _send(self, place: RegisterPlace, words: Sequence[int], called: str, **how: Any) -> Exchange[Any]:
        ask = self._dialect.writing(place, words)
        if not self.answers:
            yield Tell(message=ask.message)
        elif silence_s := self._dialect.silence_s(ask.message):
            yield from self._prepare(place, called, urgent=bool(how.get("urgent")))
            yield Tell(message=ask.message, pause_s=silence_s)
        else:
            return (yield from self._done(replace(ask, acts=True, **how), called, place))

    def _done(self, ask: Ask, called: str, place: RegisterPlace) -> Exchange[Any]:
        """Send a request on which the drive acts, and make sure that the reply is not an echo.

        If an echo could be the reply, a read proves that the drive is there. A stop is sent before the read and again
        after it; any other request is sent after it.
        """
        doubted = self._dialect.doubts_echoes and ask.mirrored and not self.is_there
        first = self._dialect.probe
        look = partial(self.send_request, self._dialect.reading(first, 1), self._dialect.address_at(first), first)
        if doubted and not ask.urgent:
            yield from look()
        reply = yield from self.send_request(ask, called, place)
        if doubted and ask.urgent:
            yield from look()
            reply = yield from self.send_request(ask, called, place)
        return reply

    def _prepared(self, ask: Ask, called: str, place: RegisterPlace | None) -> Exchange[Any]:
        """Send a request for a place, after the request that prepares it.

        Without a reply both are sent again, since the drive may have restarted meanwhile.
        """
        if place is None or self._dialect.preparing(place) is None:
            return (yield ask)
        left = ask.attempts or _TRIES
        while True:
            left -= 1
            try:
                yield from self._prepare(place, called, urgent=ask.urgent)
                return (yield replace(ask, prepared=True))
            except (OvertakenError, DeadlineError):
                raise
            except ReplyError:
                if not left:
                    raise

    def _prepare(self, place: RegisterPlace, called: str, *, urgent: bool) -> Exchange[None]:
        if (ask := self._dialect.preparing(place)) is not None:
            yield from self.send_request(replace(ask, urgent=urgent), called)
