"""A drive as the link sees it, the link's record of this drive, and the trace events of a line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.link.health import Health
from drivecomm.link.other_masters import STRAGGLING_S, OpenRequest
from drivecomm.link.statistics import Statistics
from drivecomm.protocol import LINE_ERROR

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Codec, Exchange, LineFacts, LineSettings, Message

_MOST_WRITTEN = 512
"""Maximum number of cached requests: more than a poll plan sends to one drive.

A caller with even more different requests gains nothing from the cache.
"""

_MOST_OWED = 5
"""Maximum number of late replies of one drive to expect at a time; equal replies can outvote this number."""

_MOST_KNOWN = 128
"""Maximum number of cached replies: enough for the values of one drive that a poll plan reads in some seconds."""

What: TypeAlias = Literal["sent", "received", "echo", "stray", "damaged", "noise", "note"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceEvent:
    """An event on the line.

    what: sent and received are telegrams of an exchange; echo: our own bytes; stray: a sound telegram that does not
    answer the request; damaged and noise: bytes that do not form a telegram; note: a remark about the line itself.
    drive: the drive of the exchange. detail: the reason for strays and damage; the text of a note.
    """

    time: float
    what: What
    drive: str
    data: bytes = b""
    message: Message | None = None
    detail: str = ""


class EncodeCache:
    """Cache of encoded messages, by message object: a frozen message always gives the same telegram.

    Equal messages are not looked up. That would take about as long as encoding, and True is equal to 1.
    """

    def __init__(self, write: Callable[[Message], bytes]) -> None:
        self._write = write
        self._kept: dict[int, tuple[Message, bytes]] = {}

    def telegram(self, message: Message) -> bytes:
        """Return the bytes of a message. Raises what the encoder raises."""
        kept = self._kept.get(id(message))
        if kept is not None:
            return kept[1]
        data = self._write(message)
        if len(self._kept) >= _MOST_WRITTEN:
            self._kept.clear()
        # Keep the message, so that no other object can get its identity.
        self._kept[id(message)] = (message, data)
        return data


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """A drive as the link sees it: its name, its telegrams, and the timing that it needs on the line.

    mismatch: returns the first field in which a sound reply does not belong to the request. probe: checks that the
    drive is there and moves nothing; None for all drives of a protocol. set_up: run after the drive was away, before
    any other exchange. prove: shows that the drive is of its model's series before its first command, and warns if the
    proof is weak; check_series: the same without the warning, which it returns as text. Both are None if no proof is
    needed. line_errors: see `Protocol`; a reply with one of these codes differs in LINE_ERROR. cautious: the same drive
    without its tuned turnaround; None if it has none. known: cache of sound replies, by their bytes and those of their
    requests, because nearly all replies of a plant repeat earlier ones. telegram: encodes a message, and caches the
    result.
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
        # Computed once, because every exchange needs them.
        object.__setattr__(self, "protocol", self.name.partition(":")[0])
        object.__setattr__(self, "settings", _one_of(self.facts.settings))
        object.__setattr__(self, "character_s", self.facts.settings.character_s)
        object.__setattr__(self, "shortest", self.codec.measure(b"", "reply") or 1)
        object.__setattr__(self, "gap_s", self.facts.gap_s)
        object.__setattr__(self, "turnaround_s", self.facts.turnaround_s)
        object.__setattr__(self, "telegram", EncodeCache(self.codec.encode).telegram)
        if self.line_errors:
            object.__setattr__(self, "mismatch", _OrLineError(self.mismatch, self.line_errors))
            object.__setattr__(self, "line_errors", {})
        untuned = self.facts.untuned
        object.__setattr__(self, "cautious", None if untuned is self.facts else replace(self, facts=untuned))

    def arrives_within_s(self, request: bytes, *, paced: bool) -> float:
        """Return the time in seconds between a reply's first character on the wire and its arrival at this end.

        A network may pass on a reply only when it is complete, which takes about as long as its request.
        """
        return self.character_s * (1 if paced else max(len(request), self.shortest))

    def know(self, request: bytes, reply: bytes, message: Message) -> None:
        """Remember that a reply is sound and answers a request; a full cache is emptied first."""
        if len(self.known) >= _MOST_KNOWN:
            self.known.clear()
        self.known[request, reply] = message


@dataclass(frozen=True, slots=True)
class _OrLineError:
    """Mismatch function that also detects the report of a damaged request in a reply; equal for equal drives."""

    mismatch: Callable[[Message, Message], str]
    line_errors: Mapping[str, frozenset[object]] = field(hash=False)

    def __call__(self, request: Message, reply: Message) -> str:
        differs = self.mismatch(request, reply)
        if differs or not any(getattr(reply, name, None) in codes for name, codes in self.line_errors.items()):
            return differs
        return LINE_ERROR


@lru_cache(64)
def _one_of(settings: LineSettings) -> LineSettings:
    """Return the same object for equal settings, so that an exchange needs to compare identities only."""
    return settings


class DriveRecord:
    """The link's record of one drive.

    asked_at: time of its last request. commanded_at: time of the last command that restarted its watchdog. late_until:
    end of the time in which the reply to the request `unanswered` may still come. surplus: whether that request was
    answered but sent more than once. nameless: whether its reply names nothing of the request. owed: requests whose
    reply may still come, however late. last: the last answered request, and its reply. soonest_s, latest_s: shortest
    and longest time from a request to its reply, learnt from replies after which the link listened on.
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
        self.owed: list[OpenRequest] = []
        self.last = (b"", b"")
        self.soonest_s = float("inf")
        self.latest_s = float("-inf")

    def owes(self, question: OpenRequest) -> None:
        """Record that the reply to a request may still come; beyond the limit, the two oldest requests count as one."""
        self.owed.append(question)
        if len(self.owed) > _MOST_OWED:
            oldest = self.owed.pop(0)
            self.owed[0] = self.owed[0].with_alternative(oldest)

    def copy_owed(self, other: DriveRecord) -> None:
        """Copy the late replies that another drive still owes, because these replies name no drive."""
        self.late_until, self.unanswered, self.nameless = other.late_until, other.unanswered, other.nameless
        self.owed = [*other.owed]

    def answered_after(self, seconds: float, spread_s: float) -> None:
        """Record the time of a reply.

        The longest time rises immediately with a slower reply, and falls gradually with quicker ones.
        """
        self.soonest_s = min(self.soonest_s, seconds - spread_s)
        self.latest_s = seconds if seconds > self.latest_s else 0.98 * self.latest_s + 0.02 * seconds

    def may_be_late(self, now: float) -> bool:
        """Return whether a reply to an earlier request may come now."""
        return any(each.until - STRAGGLING_S > now for each in self.owed)

    def has_come(self, reply: Message) -> bool:
        """Return whether a reply may be an outstanding one; if so, it is no longer expected."""
        fitting = [number for number, question in enumerate(self.owed) if question.may_bring(reply)]
        if not fitting:
            return False
        came = self.owed[fitting[0]]
        for number in fitting[1:]:
            self.owed[number] = self.owed[number].with_alternative(came)
        del self.owed[fitting[0]]
        return True

    def is_copy(self, reply: bytes) -> bool:
        """Return whether this is a copy of the last reply, as if its request or the reply was doubled.

        Only the first copy counts as one.
        """
        if reply != self.last[1]:
            return False
        self.last = self.last[0], b""
        return True

    def still_owes(self, now: float) -> bool:
        """Return whether the reply to an earlier request may still come, however late."""
        self.owed = [each for each in self.owed if each.until > now]
        return bool(self.owed)

    def late_rivals(self, asked: OpenRequest, reply: Message) -> int:
        """Return the number of outstanding replies to other requests that may look like this reply.

        This reply may be one of them; the reply to its own request is then outstanding in its place, which is recorded.
        """
        rivals = [
            number
            for number, each in enumerate(self.owed)
            if (each.data != asked.data or each.instead) and each.may_bring(reply)
        ]
        for number in rivals:
            self.owed[number] = self.owed[number].with_alternative(asked)
        return len(rivals)
