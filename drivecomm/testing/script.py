"""Scripts: the steps of an exchange vector compared with a master, and messages compared with an exchange.

This module does no I/O and has no clock: the caller passes the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

from drivecomm.errors import ReplyError
from drivecomm.protocol import Ask, LineSettings, run_with_answers
from drivecomm.testing.checking import CheckFailure, message_hex

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.protocol import Exchange, Message, Tell
    from drivecomm.testing.exchange_vectors import WireStep


T = TypeVar("T")

# Tolerance: sums of character times are not exact.
_TINY_S = 1e-9


@dataclass(frozen=True, slots=True)
class Arriving:
    """Bytes for the master, with the times at which their first character begins and their last one ends."""

    begins: float
    ends: float
    data: bytes


class Script:
    """Scripted line: returns the bytes that reach the master, and checks the bytes that it sends.

    reply_time_s: how long the master must wait for a missing reply, 0 if no reply is expected. wire_s: returns the
    seconds that a number of characters take. slack_s: how much too early a master may be where clocks are real. A
    deviation raises CheckFailure immediately, and again at the end, because the code under test could have caught the
    first one.
    """

    def __init__(
        self,
        steps: Sequence[WireStep],
        *,
        reply_time_s: float,
        wire_s: Callable[[float], float],
        slack_s: float = _TINY_S,
    ) -> None:
        self._steps = steps
        self._reply_time_s = reply_time_s
        self._wire_s = wire_s
        self._slack_s = slack_s
        self._place = 0
        self._over_at = 0.0
        self._patient_until = 0.0
        self._why_not_before = ""
        self._deviation = ""

    def begin(self, now: float) -> list[Arriving]:
        """Start the script at this time, and return the bytes that arrive before the master's first request."""
        self._over_at = now
        return self._until_next_send(now, sent_at=None)

    def expected(self) -> bytes:
        """Return the bytes that the master must send next, or b"" at the end of the script."""
        return self._steps[self._place].data if self._place < len(self._steps) else b""

    def sent(self, data: bytes, began: float) -> list[Arriving]:
        """Check what the master sends and when; return the bytes that arrive next. Raises CheckFailure."""
        expected = self.expected()
        if not expected:
            raise self._deviates(f"the steps have ended, and the master sends {message_hex(data)}")
        if data != expected:
            raise self._deviates(
                f"step {self._place + 1}: the master sends {message_hex(data)}, not {message_hex(expected)}"
            )
        if began < self._over_at - self._slack_s:
            early = (self._over_at - began) * 1000
            raise self._deviates(
                f"step {self._place + 1}: the master sends {message_hex(data)} {early:.3f} ms too early"
                f"{self._why_not_before}"
            )
        ended = began + self._wire_s(len(data))
        self._place += 1
        return self._until_next_send(ended, sent_at=ended)

    def over(self, now: float, unread: bytes = b"") -> None:
        """Check that the script was played to its end. Raises CheckFailure.

        unread: bytes that the master has not read.
        """
        if self._deviation:
            raise CheckFailure(self._deviation)
        if expected := self.expected():
            raise CheckFailure(f"step {self._place + 1}: the master never sends {message_hex(expected)}")
        if self._patient_until and now < self._patient_until - self._slack_s:
            early = (self._patient_until - now) * 1000
            raise CheckFailure(f"the master times out {early:.3f} ms too early{self._why_not_before}")
        if unread:
            raise CheckFailure(f"{message_hex(unread)} was left on the line")

    def _until_next_send(self, time: float, *, sent_at: float | None) -> list[Arriving]:
        arriving = []
        self._why_not_before = ""
        self._patient_until = 0.0
        not_before = time
        just_sent = sent_at is not None
        while self._place < len(self._steps) and self._steps[self._place].action != "send":
            step = self._steps[self._place]
            self._place += 1
            if step.action == "silence":
                reply_time_s = self._reply_time_s if step.seconds is None else step.seconds
                # The first character after the silence ends when the reply timeout has passed.
                time = max(time, (sent_at or 0.0) + reply_time_s)
                if just_sent and reply_time_s:
                    # After damage or noise the master may know before the timeout that no reply will follow.
                    self._patient_until = not_before = time
                    self._why_not_before = f": the reply time of step {self._place} is {reply_time_s * 1000:g} ms"
            elif step.action == "pause_s":
                not_before = max(not_before, time + (step.seconds or 0.0))
                self._why_not_before = f" for the pause of step {self._place}"
            else:
                begins = time + (step.seconds or 0.0)
                time = begins + self._wire_s(len(step.data))
                arriving.append(Arriving(begins, time, step.data))
                not_before = time
                self._why_not_before = f": step {self._place} ({step.action}) has not ended"
            just_sent = False
        self._over_at = not_before
        return arriving

    def _deviates(self, how: str) -> CheckFailure:
        self._deviation = self._deviation or how
        return CheckFailure(how)


Expectation: TypeAlias = "tuple[Message, Message | ReplyError | None]"
"""The next expected message of the exchange and its answer: a reply, an error to throw in, or None for a `Tell`."""


class ScriptError(AssertionError):
    """The exchange deviates from its script."""


def play(exchange: Exchange[T], script: Iterable[Expectation]) -> T:
    """Play an exchange to its end and return its result. Pauses are skipped. Raises ScriptError if it deviates."""
    steps = iter(script)

    def answer(command: Ask | Tell) -> Message | None:
        request, reply = next(steps, (None, None))
        if request is None:
            raise ScriptError(f"the script has ended, and the exchange sends {command.message}")
        if command.message != request:
            raise ScriptError(f"the exchange sends {command.message}, the script says {request}")
        if isinstance(command, Ask) and reply is None:
            raise ScriptError(f"the exchange waits for a reply to {request}, the script has none")
        if isinstance(reply, ReplyError):
            raise reply
        return reply

    result = run_with_answers(exchange, answer)
    if (left := next(steps, None)) is not None:
        raise ScriptError(f"the exchange has ended, and the script continues with {left[0]}")
    return result


class _Character(NamedTuple):
    ends: float
    byte: int
    echo: bool = False


class ScriptedPort:
    """The master's port on a line that is played from a script.

    echo: the master receives its own bytes. in_lumps: bytes are delivered when a telegram is complete, as by an adapter
    that collects them. `follow` must be called before the first byte is sent.
    """

    paced = True
    real_time = False
    descriptor = None

    def __init__(self, *, echo: bool = False, in_lumps: bool = False) -> None:
        self._script: Script | None = None
        self._echo = echo
        self._in_lumps = in_lumps
        self._settings = LineSettings()
        self._time = 0.0
        self._sending_until = 0.0
        self._coming: list[_Character] = []

    def follow(self, steps: Sequence[WireStep], reply_time_s: float) -> None:
        """Play these steps from now on, as a `Script`."""
        self._script = Script(steps, reply_time_s=reply_time_s, wire_s=self._wire_s)
        self._come(self._script.begin(self._time))

    def over(self) -> None:
        """Check that the script was played and that no bytes are left unread. Raises CheckFailure."""
        if self._script is not None:
            unread = bytes(character.byte for character in self._coming if not character.echo)
            self._script.over(self._time, unread)

    def now(self) -> float:
        """Return the time in seconds since the start."""
        return self._time

    def wall_time(self) -> float:
        """Return the same time as `now`."""
        return self._time

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings, which determine the duration of a character."""
        self._settings = settings
        return ""

    def write(self, data: bytes) -> None:
        """Check the bytes against the script, and queue its reply. Raises CheckFailure for any other bytes."""
        began = max(self._time, self._sending_until)
        self._sending_until = began + self._wire_s(len(data))
        if self._echo:
            self._coming += [_Character(began + self._wire_s(place), byte, True) for place, byte in enumerate(data, 1)]
        if self._script is not None:
            self._come(self._script.sent(data, began))

    def read(self, until: float, at_least: int) -> bytes:
        """Advance the time until this many bytes have arrived, at most to `until`, and return them."""
        wanted = max(1, at_least)
        ready = self._coming[wanted - 1].ends if len(self._coming) >= wanted else until
        self._time = max(self._time, min(ready, until))
        return self.take()

    def take(self) -> bytes:
        """Return the bytes that have arrived so far."""
        came = [character.byte for character in self._coming if character.ends <= self._time]
        self._coming = self._coming[len(came) :]
        return bytes(came)

    def hold_back(self, at_least: int) -> None:
        """Do nothing: there is no descriptor."""

    def wait(self, until: float) -> None:
        """Advance the time."""
        self._time = max(self._time, until)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _wire_s(self, characters: float) -> float:
        return self._settings.wire_s(characters)

    def _come(self, arriving: list[Arriving]) -> None:
        for each in arriving:
            for number, byte in enumerate(each.data, 1):
                ends = each.ends if self._in_lumps else each.begins + self._wire_s(number)
                self._coming.append(_Character(ends, byte))
