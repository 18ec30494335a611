"""A capture as a master: sends the recorded requests at their pace or faster, and compares the replies.

Nothing moves by accident: requests that could command or write are left out unless the caller includes them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError, UsageError
from drivecomm.link import EchoFilter
from drivecomm.protocol import fields_of
from drivecomm.traffic.replay.exchanges import decoded_requests, only_asks

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.link import Echo, Port
    from drivecomm.protocol import LineSettings, Protocol
    from drivecomm.traffic.replay.exchanges import RecordedExchange

# A lower limit at any speed: of the protocols shipped, Fuji needs the longest pause before a request, 10 ms.
_LEAST_PAUSE_S = 0.010
PATIENCE_S = 0.5
"""Extra time for a reply compared with the capture, in seconds."""


class Sending(Enum):
    """The part of a capture to send again: only read requests, or everything."""

    QUESTIONS = "questions"
    EVERYTHING = "everything"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedRequest:
    """The result of a replayed request.

    number: its place in the capture, from 1. then: the recorded exchange. came: the reply now. sent: False if the
    request was skipped.
    """

    number: int
    then: RecordedExchange
    came: bytes = b""
    sent: bool = True

    @property
    def differs(self) -> bool:
        """Whether the reply differs from the recorded one."""
        return self.sent and self.came != self.then.reply


class ReplayMaster:
    """A master that sends the requests of a recorded conversation on a port.

    faster: speed relative to the capture. sending: whether requests that could command or write are sent as well.
    overrides: line settings that replace those of the capture, by name. echo: whether the adapter echoes the sent
    bytes. patience_s: extra seconds for a reply compared with the capture. Raises UsageError unless the speed is above
    0.
    """

    def __init__(
        self,
        conversation: Sequence[RecordedExchange],
        protocols: Sequence[Protocol],
        *,
        faster: float = 1.0,
        sending: Sending = Sending.QUESTIONS,
        overrides: Mapping[str, Any] | None = None,
        echo: Echo = "off",
        patience_s: float = PATIENCE_S,
    ) -> None:
        if not 0 < faster < float("inf"):
            raise UsageError(f"{faster:g} is not a valid speed factor; give a number above 0")
        self._conversation = conversation
        self._protocols = protocols
        self._faster = faster
        self._sending = sending
        self._overrides = dict(overrides or {})
        self._echo = EchoFilter(echo)
        self._patience_s = patience_s

    def on(self, port: Port) -> Iterator[ReplayedRequest]:
        """Yield the result of each request, in order. Raises LinkDownError if the port is lost."""
        configured: LineSettings | None = None
        began: float | None = None
        first_s = self._conversation[0].asked_s if self._conversation else 0.0
        free_at = 0.0
        for number, then in enumerate(self._conversation, start=1):
            if self._sending is Sending.QUESTIONS and not only_asks(then.request, self._protocols):
                yield ReplayedRequest(number=number, then=then, sent=False)
                continue
            settings = replace(then.settings or self._usual(then), **self._overrides)
            if settings != configured:
                port.configure(settings)
                configured = settings
            if began is None:
                began = port.now()
            port.wait(max(began + (then.asked_s - first_s) / self._faster, free_at))
            port.take()
            port.write(then.request)
            if self._echo.looking:
                self._echo.sent(then.request)
            over_at = port.now() + settings.wire_s(len(then.request))
            came = self._reply(port, then, over_at, number)
            free_at = max(over_at, port.now()) + self._pause_s(number)
            yield ReplayedRequest(number=number, then=then, came=came)

    def _reply(self, port: Port, then: RecordedExchange, over_at: float, number: int) -> bytes:
        """Return the reply: read as many bytes as in the capture; if it has none, listen for a short time."""
        wanted = len(then.reply)
        until = over_at + then.reply_s + self._patience_s if wanted else over_at + self._silence_s(number)
        came = b""
        while (now := port.now()) < until:
            came += self._heard(port.read(until, max(1, wanted - len(came)) + self._echo.missing))
            if wanted and len(came) >= wanted:
                # Bytes that follow immediately belong to the reply.
                surplus_at = max(now, port.now()) + _LEAST_PAUSE_S / 2
                return came + self._heard(port.read(surplus_at, wanted + 1))
        return came + self._echo.give_up()

    def _heard(self, came: bytes) -> bytes:
        return self._echo.take(came)[1] if self._echo.looking and came else came

    def _silence_s(self, number: int) -> float:
        """Return the seconds to listen if the capture has no reply: until its next request, within limits."""
        return min(self._patience_s, max(_LEAST_PAUSE_S, self._until_next_s(number) / self._faster))

    def _pause_s(self, number: int) -> float:
        """Return the seconds to pause after this request: as in the capture, but no longer than any drive needs."""
        return max(0.0, min(self._until_next_s(number), _LEAST_PAUSE_S))

    def _until_next_s(self, number: int) -> float:
        """Return the seconds from the recorded reply to the next recorded request."""
        if number >= len(self._conversation):
            return self._patience_s
        then = self._conversation[number - 1]
        return self._conversation[number].asked_s - then.asked_s - then.reply_s

    def _usual(self, then: RecordedExchange) -> LineSettings:
        """Return the usual line settings of the request's protocol. Raises UsageError if no protocol decodes it."""
        for plugin, _ in decoded_requests(then.request, self._protocols):
            return plugin.facts.settings
        raise UsageError("the capture does not say its line settings; give --baudrate, --parity and so on")


def difference(outcome: ReplayedRequest, protocols: Sequence[Protocol]) -> str:
    """Return the difference between a reply and the recorded one, by field if both are sound, else by bytes."""
    if not outcome.came:
        return "nothing came"
    if not outcome.then.parts:
        return f"nothing came then, now {outcome.came.hex(' ').upper()}"
    for plugin, _ in decoded_requests(outcome.then.request, protocols):
        codec = plugin.codec(plugin.options())
        try:
            then = fields_of(codec.decode(outcome.then.reply, "reply"))
            now = fields_of(codec.decode(outcome.came, "reply"))
        except TelegramError:
            continue
        names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
        return ", ".join(f"{name} was {then.get(name, 'absent')}, is {now.get(name, 'absent')}" for name in names)
    return f"was {outcome.then.reply.hex(' ').upper()}, is {outcome.came.hex(' ').upper()}"
