"""The sans-I/O link: sends, frames, correlates, repeats, drains. It yields effects and is resumed with what came.

One link serves one line. It never sleeps and never reads a clock: the runner tells the time with every resumption.

    Configure   set the port to these line settings
    Send        write these bytes
    Receive     wait for bytes until a time; `at_least` says how few are of no use yet
    Wait        let time pass until then
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from drivecomm.errors import DamagedReplyError, NoReplyError, ReplyError
from drivecomm.exchange import Ask, Pause, Tell
from drivecomm.framing import Damaged, Framed, Framer, Noise

if TYPE_CHECKING:
    from drivecomm.exchange import Exchange
    from drivecomm.framing import Codec
    from drivecomm.line import LineFacts, LineSettings
    from drivecomm.telegram import Message

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Configure:
    """Set the port to these line settings."""

    settings: LineSettings


@dataclass(frozen=True, slots=True)
class Send:
    """Write these bytes."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Receive:
    """Wait for bytes until this time; return early only with at least this many."""

    until: float
    at_least: int = 1


@dataclass(frozen=True, slots=True)
class Wait:
    """Let time pass until then."""

    until: float


Effect: TypeAlias = Configure | Send | Receive | Wait


@dataclass(frozen=True, slots=True)
class Arrival:
    """The time, and the bytes that came (for Receive)."""

    time: float
    data: bytes = b""
    note: str = ""


Steps: TypeAlias = Generator[Effect, Arrival, T]

What: TypeAlias = Literal["sent", "received", "echo", "stray", "damaged", "noise", "note"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceEvent:
    """Something that happened on the line.

    what: sent and received telegrams of an exchange; echo: our own bytes; stray: a sound telegram that does not answer
    the request; damaged and noise: bytes that are no telegram; note: something about the line itself.
    drive: the drive that the exchange is with. detail: why, for strays and damage; the text of a note.
    """

    time: float
    what: What
    drive: str
    data: bytes = b""
    message: Message | None = None
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Party:
    """A drive as the link sees it: who it is, how its telegrams look, what holds on the line for it."""

    name: str
    codec: Codec
    facts: LineFacts
    mismatch: Callable[[Message, Message], str]


class Link:
    """One line. `run` turns an exchange with a drive into effects for a runner.

    echo: the adapter hands back what it sends; those bytes are dropped before a reply is looked for.
    guard_s: quiet time after the line settings change, for receivers to settle. paced: whether characters take their
    time on this port, as on a real line; then nothing that comes before a request is out can answer it.
    """

    def __init__(
        self, *, trace: Callable[[TraceEvent], None] | None = None, echo: bool = False, guard_s: float = 0.005
    ) -> None:
        self._trace = trace
        self._echo = echo
        self._guard_s = guard_s
        self.paced = False
        self._settings: LineSettings | None = None
        self._now = 0.0
        self._free_at = 0.0
        self._sent_at = 0.0
        self._heard_at = float("-inf")
        self._unclean = False
        self._late: dict[str, tuple[float, bytes]] = {}
        self.counters: dict[str, Counter[str]] = {}

    def reopened(self) -> None:
        """Forget what held for the port before it was opened anew."""
        self._settings = None
        self._unclean = False

    def run(self, party: Party, exchange: Exchange[T]) -> Steps[T]:
        """Carry out an exchange with a drive and return its result. Raises what the exchange raises.

        An exchange that is cut off in the middle (by closing this generator) leaves the link unclean: the next one
        begins with draining the line.
        """
        self._now = (yield Wait(0.0)).time
        yield from self._settle(party)
        if self._unclean:
            self._heard_at = self._now
            yield from self._drain(party)
        self._unclean = True
        try:
            command = next(exchange)
            while True:
                try:
                    outcome = yield from self._perform(party, command)
                except ReplyError as error:
                    command = exchange.throw(error)
                else:
                    command = exchange.send(outcome)
        except StopIteration as finished:
            self._unclean = False
            result: T = finished.value
            return result
        except GeneratorExit:
            exchange.close()
            raise
        except Exception:
            # The exchange ended by its own decision; what had to be drained was drained where it went wrong.
            self._unclean = False
            raise

    def _perform(self, party: Party, command: Ask | Tell | Pause) -> Steps[Message | None]:
        if isinstance(command, Pause):
            yield from self._wait(self._now + command.seconds)
            return None
        data = party.codec.encode(command.message)
        if isinstance(command, Tell):
            yield from self._send(party, data, command.message)
            pause = party.facts.broadcast_pause_s if command.pause_s is None else command.pause_s
            self._free_at = self._sent_at + pause
            return None
        return (yield from self._ask(party, command, data))

    def _ask(self, party: Party, ask: Ask, data: bytes) -> Steps[Message]:
        attempts = ask.attempts or party.facts.timing.attempts
        yield from self._outwait_late_reply(party, ask, data)
        for attempt in range(1, attempts + 1):
            self._count(party, "requests" if attempt == 1 else "retries")
            try:
                yield from self._send(party, data, ask.message)
                hint = yield from self._pass_over_early_bytes(party, data)
                message = yield from self._await_reply(party, ask, data, hint)
            except ReplyError as error:
                self._count(party, "timeouts" if isinstance(error, NoReplyError) else "damaged")
                yield from self._drain(party)
                self._expect_late_reply(party, ask, data)
                if attempt == attempts:
                    raise type(error)(f"{error}{_times(attempt)}{_OPEN if ask.acts else ''}") from None
            except GeneratorExit:
                self._expect_late_reply(party, ask, data)
                raise
            else:
                self._count(party, "replies")
                return message
        raise AssertionError("attempts is at least 1")  # pragma: no cover

    def _await_reply(self, party: Party, ask: Ask, data: bytes, hint: str) -> Steps[Message]:
        """Return the reply that answers; hint says what may have kept it away."""
        facts, settings, timing = party.facts, party.facts.settings, party.facts.timing
        timeout = timing.reply_timeout_s if ask.reply_timeout_s is None else ask.reply_timeout_s
        limit = self._sent_at + settings.character_s + timeout
        latest = limit + settings.wire_s(_LONGEST_TELEGRAM) + facts.gap_s
        framer = Framer(party.codec, "reply")
        echo = data if self._echo else b""
        damage, stray = "", hint
        deadline = limit
        while True:
            came = yield from self._receive(deadline, framer.missing + len(echo))
            quiet = not came
            if came and echo:
                came, echo = self._without_echo(party, came, echo)
            for find in framer.flush() if quiet else framer.feed(came):
                if isinstance(find, Framed):
                    reason = "echo" if find.data == data else party.mismatch(ask.message, find.message)
                    if not reason:
                        self._free_at = self._now + facts.turnaround_s
                        self._note(party, "received", find.data, find.message)
                        return find.message
                    self._stray(party, find, reason)
                    stray = _ECHO if reason == "echo" else f"the reply that came differs in {reason}"
                else:
                    damage = self._garbage(party, find) or damage
            if (quiet and damage) or self._now >= min(max(limit, deadline), latest):
                break
            # Once bytes have come only the gap limit counts; without any, the reply time keeps running.
            waiting = framer.missing > 1 or bool(damage)
            deadline = self._now + settings.wire_s(framer.missing) + facts.gap_s if waiting else limit
        if damage:
            raise DamagedReplyError(f"{party.name} answered with a damaged telegram ({damage})")
        why = f": {stray}" if stray else ""
        raise NoReplyError(f"{party.name} did not answer within {timeout * 1000:.0f} ms{why}")

    def _without_echo(self, party: Party, came: bytes, echo: bytes) -> tuple[bytes, bytes]:
        length = min(len(came), len(echo))
        if came[:length] != echo[:length]:
            return came, b""
        self._count(party, "echo bytes", length)
        self._note(party, "echo", came[:length])
        return came[length:], echo[length:]

    def _send(self, party: Party, data: bytes, message: Message) -> Steps[None]:
        yield from self._settle(party)
        yield from self._wait(self._free_at)
        came = yield from self._receive(self._now)
        if came:
            # Something speaks out of turn (a repeated or late reply): let it finish before we add to it.
            self._count(party, "unasked bytes", len(came))
            yield from self._drain(party)
        self._sent_at = self._now + party.facts.settings.wire_s(len(data))
        # Whatever comes of it, nobody may speak, or change the line settings, before it is on the wire.
        self._free_at = self._sent_at
        arrival = yield Send(data)
        self._now = arrival.time
        self._note(party, "sent", data, message)

    def _pass_over_early_bytes(self, party: Party, data: bytes) -> Steps[str]:
        """Drop what comes while the request is still on its way: a repeated or late reply to an earlier one.

        Returns a hint when it is the request itself.
        """
        if not self.paced or self._echo:
            return ""
        came = yield from self._receive(self._sent_at, _EVERYTHING)
        if not came:
            return ""
        if came[: len(data)] == data:
            self._count(party, "echo bytes", len(data))
            self._note(party, "echo", came)
            return _ECHO
        self._count(party, "unasked bytes", len(came))
        self._note(party, "noise", came, detail="came before the request was out")
        return ""

    def _settle(self, party: Party) -> Steps[None]:
        """Bring the port to the drive's line settings."""
        if self._settings == party.facts.settings:
            return
        yield from self._wait(self._free_at)
        # Whoever is interrupted in the middle of this no longer knows how the port stands.
        before, self._settings = self._settings, None
        arrival = yield Configure(party.facts.settings)
        self._now = arrival.time
        if arrival.note:
            self._note(party, "note", detail=arrival.note)
        if before is not None:
            self._free_at = max(self._free_at, self._now + self._guard_s)
        self._settings = party.facts.settings

    def _drain(self, party: Party) -> Steps[None]:
        """Read until the line has been quiet for the drive's gap, at most for one reply time."""
        gap = party.facts.gap_s
        limit = self._now + max(party.facts.timing.reply_timeout_s, gap)
        while (quiet_at := min(limit, self._heard_at + gap)) > self._now:
            came = yield from self._receive(quiet_at)
            if came:
                self._count(party, "drained bytes", len(came))
                self._note(party, "noise", came, detail="drained")

    def _expect_late_reply(self, party: Party, ask: Ask, data: bytes) -> None:
        """Keep in mind that a reply which does not name its request may still come."""
        if ask.nameless:
            self._late[party.name] = (self._now + party.facts.timing.late_s, data)

    def _outwait_late_reply(self, party: Party, ask: Ask, data: bytes) -> Steps[None]:
        """Do not ask for something else while a reply that does not name its request may still come."""
        until, unanswered = self._late.get(party.name, (0.0, data))
        if unanswered == data:
            return
        del self._late[party.name]
        if ask.urgent and self._now < until:
            yield from self._send(party, data, ask.message)
        yield from self._wait(until)
        yield from self._drain(party)

    def _receive(self, until: float, at_least: int = 1) -> Steps[bytes]:
        arrival = yield Receive(until, at_least)
        self._now = arrival.time
        if arrival.data:
            self._heard_at = arrival.time
        return arrival.data

    def _wait(self, until: float) -> Steps[None]:
        if self._now < until:
            arrival = yield Wait(until)
            self._now = arrival.time

    def _stray(self, party: Party, find: Framed, reason: str) -> None:
        what: What = "echo" if reason == "echo" else "stray"
        self._count(party, "echoes" if reason == "echo" else "strays")
        self._note(party, what, find.data, find.message, detail=reason)

    def _garbage(self, party: Party, find: Damaged | Noise) -> str:
        """Count and trace; return what is wrong with a damaged telegram, nothing for noise that was never one."""
        if isinstance(find, Noise):
            self._count(party, "noise bytes", len(find.data))
            self._note(party, "noise", find.data)
            return ""
        self._count(party, f"{find.error.category} errors")
        self._note(party, "damaged", find.data, detail=str(find.error))
        return str(find.error)

    def _count(self, party: Party, what: str, number: int = 1) -> None:
        self.counters.setdefault(party.name, Counter())[what] += number

    def _note(
        self, party: Party, what: What, data: bytes = b"", message: Message | None = None, detail: str = ""
    ) -> None:
        if self._trace is not None:
            self._trace(
                TraceEvent(time=self._now, what=what, drive=party.name, data=data, message=message, detail=detail)
            )


# The longest one that exists has 257 bytes (Danfoss FC with LGE 255); a line that never falls silent is not waited for.
_LONGEST_TELEGRAM = 257

# More than can come in one wait: wait to its end and take what there is.
_EVERYTHING = 1 << 20

_OPEN = "; whether the drive acted on it is not known"
_ECHO = "the adapter hands back what it sends, and no other reply came; open the port with echo on"


def _times(attempts: int) -> str:
    return "" if attempts == 1 else f" (asked {attempts} times)"
