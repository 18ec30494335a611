"""A drive as the link sees it, what the link remembers of it, and what happens with it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.link.health import Health
from drivecomm.link.other_masters import STRAGGLING_S, Question
from drivecomm.link.statistics import Statistics
from drivecomm.protocol import LINE_ERROR

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Codec, Exchange, LineFacts, LineSettings, Message

_MOST_WRITTEN = 512
"""Requests; more than a poll plan asks of one drive. Who goes through more than that gains nothing by keeping them."""

_MOST_OWED = 5
"""Late replies of one drive that are reckoned with at the same time; so many can be outvoted by equal answers."""

_MOST_KNOWN = 128
"""Replies; more than the values that a poll plan reads of one drive go through in some seconds."""

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


class Written:
    """Writes messages and keeps what it wrote, by the message object: a frozen message is always the same telegram.

    Equal messages are not looked for. That would take about as long as writing, and True is equal to 1.
    """

    def __init__(self, write: Callable[[Message], bytes]) -> None:
        self._write = write
        self._kept: dict[int, tuple[Message, bytes]] = {}

    def telegram(self, message: Message) -> bytes:
        """Return the bytes of a message. Raises what writing it raises."""
        kept = self._kept.get(id(message))
        if kept is not None:
            return kept[1]
        data = self._write(message)
        if len(self._kept) >= _MOST_WRITTEN:
            self._kept.clear()
        # The message is kept too, so that no other object can come to have its identity.
        self._kept[id(message)] = (message, data)
        return data


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """A drive as the link sees it: who it is, how its telegrams look, what holds on the line for it.

    mismatch: names the first field in which a sound reply does not belong to the request. probe: asks whether it is
    there, moving nothing; None for all drives at once. set_up: what must be done after it was away, before anything
    else is. prove: shows that it is of its model's series, before it is first commanded, with a warning where that
    shows little; check_series: the same without one, returning its text. Both are None where nothing has to be shown.
    line_errors: see `Protocol`; a reply with one of these codes differs in LINE_ERROR.
    cautious: the same drive without its tuned turnaround, None where there is none. known: sound replies by
    their bytes and those of the requests that they answered: nearly all of what a plant says was said before. telegram:
    writes a message, once for each that is asked again and again.
    """

    name: str
    codec: Codec
    facts: LineFacts
    mismatch: Callable[[Message, Message], str]
    probe: Callable[[], Exchange[None]] | None = None
    set_up: Callable[[], Exchange[None]] | None = None
    prove: Callable[[], Exchange[None]] | None = None
    check_series: Callable[[], Exchange[str]] | None = None
    line_errors: Mapping[str, frozenset[object]] = field(compare=False, default_factory=dict)
    protocol: str = field(init=False)
    settings: LineSettings = field(init=False)
    character_s: float = field(init=False)
    shortest: int = field(init=False)
    gap_s: float = field(init=False)
    turnaround_s: float = field(init=False)
    cautious: Peer | None = field(init=False)
    telegram: Callable[[Message], bytes] = field(init=False, compare=False, repr=False)
    known: dict[tuple[bytes, bytes], Message] = field(init=False, compare=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        # Asked for in every exchange.
        object.__setattr__(self, "protocol", self.name.partition(":")[0])
        object.__setattr__(self, "settings", _one_of(self.facts.settings))
        object.__setattr__(self, "character_s", self.facts.settings.character_s)
        object.__setattr__(self, "shortest", self.codec.measure(b"", "reply") or 1)
        object.__setattr__(self, "gap_s", self.facts.gap_s)
        object.__setattr__(self, "turnaround_s", self.facts.turnaround_s)
        object.__setattr__(self, "telegram", Written(self.codec.encode).telegram)
        if self.line_errors:
            object.__setattr__(self, "mismatch", _OrLineError(self.mismatch, self.line_errors))
            object.__setattr__(self, "line_errors", {})
        untuned = self.facts.untuned
        object.__setattr__(self, "cautious", None if untuned is self.facts else replace(self, facts=untuned))

    def arrives_within_s(self, request: bytes, *, paced: bool) -> float:
        """Return how long after its first character a reply may begin to arrive.

        A network may hand a reply on when all of it has been on the wire, which takes about as long as its request.
        """
        return self.character_s * (1 if paced else max(len(request), self.shortest))

    def know(self, request: bytes, reply: bytes, message: Message) -> None:
        """Remember that a reply is sound and answers a request; of too many, the old ones are forgotten."""
        if len(self.known) >= _MOST_KNOWN:
            self.known.clear()
        self.known[request, reply] = message


@dataclass(frozen=True, slots=True)
class _OrLineError:
    """What a reply differs in, that it says that the request came damaged with it; equal for equal drives."""

    mismatch: Callable[[Message, Message], str]
    line_errors: Mapping[str, frozenset[object]] = field(hash=False)

    def __call__(self, request: Message, reply: Message) -> str:
        differs = self.mismatch(request, reply)
        if differs or not any(getattr(reply, name, None) in codes for name, codes in self.line_errors.items()):
            return differs
        return LINE_ERROR


@lru_cache(64)
def _one_of(settings: LineSettings) -> LineSettings:
    """Return the same object for equal settings, so that drives of one line need not be compared at each exchange."""
    return settings


class PeerState:
    """What the link remembers of one drive.

    asked_at, commanded_at: when it was last asked, and sent a command from which its watchdog counts. late_until: how
    long the reply to the request `unanswered` may still come. surplus: that one was answered, and sent more than once.
    nameless: its reply names nothing that was asked. owed: requests whose reply may still come, however late. last: the
    request that was answered last, and its reply. soonest_s, latest_s: within which time after a request this drive
    answers, as far as replies were listened out.
    """

    __slots__ = (
        "asked_at",
        "commanded_at",
        "count",
        "health",
        "last",
        "late_until",
        "latest_s",
        "nameless",
        "owed",
        "settings",
        "soonest_s",
        "statistics",
        "surplus",
        "unanswered",
        "watchdog_s",
    )

    def __init__(self, settings: LineSettings) -> None:
        self.settings = settings
        self.statistics = Statistics()
        self.count = self.statistics.counters
        self.health = Health()
        self.asked_at = float("-inf")
        self.commanded_at = float("-inf")
        self.watchdog_s = float("inf")
        self.late_until = 0.0
        self.unanswered = b""
        self.surplus = False
        self.nameless = False
        self.owed: list[Question] = []
        self.last = (b"", b"")
        self.soonest_s = float("inf")
        self.latest_s = float("-inf")

    def owes(self, question: Question) -> None:
        """Keep in mind that the reply to a request may still come; of too many, the two oldest count as one."""
        self.owed.append(question)
        if len(self.owed) > _MOST_OWED:
            oldest = self.owed.pop(0)
            self.owed[0] = self.owed[0].or_that_to(oldest)

    def owes_as(self, other: PeerState) -> None:
        """Expect the late replies that another drive may still send, and that name no drive."""
        self.late_until, self.unanswered, self.nameless = other.late_until, other.unanswered, other.nameless
        self.owed = [*other.owed]

    def answered_after(self, seconds: float, spread_s: float) -> None:
        """Take note after which time this drive has answered; slow replies are remembered longer than quick ones."""
        self.soonest_s = min(self.soonest_s, seconds - spread_s)
        self.latest_s = seconds if seconds > self.latest_s else 0.98 * self.latest_s + 0.02 * seconds

    def may_be_late(self, now: float) -> bool:
        """Whether a reply to an earlier request may come just now."""
        return any(each.until - STRAGGLING_S > now for each in self.owed)

    def has_come(self, reply: Message) -> bool:
        """Whether a reply may be one that was still to come; it is expected no longer."""
        fitting = [number for number, question in enumerate(self.owed) if question.may_bring(reply)]
        if not fitting:
            return False
        came = self.owed[fitting[0]]
        for number in fitting[1:]:
            self.owed[number] = self.owed[number].or_that_to(came)
        del self.owed[fitting[0]]
        return True

    def is_copy(self, reply: bytes) -> bool:
        """Whether this is the last reply once more, as when a request or a reply is doubled; the next one is none."""
        if reply != self.last[1]:
            return False
        self.last = self.last[0], b""
        return True

    def still_owes(self, now: float) -> bool:
        """Whether the reply to an earlier request may still come, however late."""
        self.owed = [each for each in self.owed if each.until > now]
        return bool(self.owed)

    def late_rivals(self, asked: Question, reply: Message) -> int:
        """Return how many replies to other requests than this one may still come and look like this reply.

        This may be one of them; the reply to this request is then still to come in its place.
        """
        rivals = [
            number
            for number, each in enumerate(self.owed)
            if (each.data != asked.data or each.instead) and each.may_bring(reply)
        ]
        for number in rivals:
            self.owed[number] = self.owed[number].or_that_to(asked)
        return len(rivals)
