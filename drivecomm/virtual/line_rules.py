"""What a master may not do on a line: the rules for each drive, and what broke one."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, get_args

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping

    from drivecomm.protocol import Codec, LineFacts, LineSettings, Protocol

Rule: TypeAlias = Literal[
    "reply not awaited", "turnaround", "gap in a telegram", "pause after a broadcast", "request interval",
    "line settings",
]  # fmt: skip
"""What a master may not do, by name."""

RULES: tuple[Rule, ...] = get_args(Rule)
"""All rules by name."""

DEFAULT = "a default of drivecomm"
"""The source of a number that no manual demands."""

SET_HERE = "set for this drive"
"""The source of a number that was given with the drive."""


class Limit(NamedTuple):
    """A time in seconds, and the source that demands it; empty for a default of drivecomm."""

    seconds: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A rule that a master broke, at a time of the line's clock in seconds.

    measured, allowed: seconds, or line settings as a text. source: manual and page of the allowed value. demanded:
    whether the maker, or whoever set up the drive, demands that value, so that this is a failure; otherwise the value
    is a default of drivecomm, and this is a note. drive: such as "vabus:1"; `str()` is one sentence. tolerance_s: how
    much of the measured time was put down to the process that measures.
    """

    rule: Rule
    at_s: float
    measured: float | str
    allowed: float | str
    source: str
    demanded: bool
    drive: str
    protocol: str
    text: str
    tolerance_s: float = 0.0

    def __str__(self) -> str:
        sort = "" if self.demanded else "note: "
        tolerance = f", with {in_ms(self.tolerance_s)} of tolerance" if self.tolerance_s else ""
        return f"{sort}{self.drive}: {self.text} ({self.source}{tolerance})"


@dataclass(frozen=True, kw_only=True)
class LineRules:
    """What a master has to keep to with one drive.

    name: of the drive, for people. codec: its telegrams. facts: its line settings, and the timing of its master.
    silence_characters: a pause of so many characters inside a telegram ends it; 0 where `gap_s` of the facts counts.
    sources: where a number stands that is demanded, by the name of the fact; the others are defaults of drivecomm.
    needs_pause_s: after its reply the drive does not hear what begins sooner. settings_now: the line settings that the
    drive has at the moment, where a parameter or a reset may have changed them.
    """

    name: str
    address: int
    plugin: Protocol
    codec: Codec
    facts: LineFacts
    silence_characters: float = 0.0
    sources: Mapping[str, str] = field(default_factory=dict)
    needs_pause_s: float = 0.0
    settings_now: Callable[[], LineSettings] | None = None

    def listens_with(self, told: Mapping[str, object]) -> bool:
        """Whether the drive has these line settings, now or from the beginning."""
        known = [self.facts.settings] if self.settings_now is None else [self.facts.settings, self.settings_now()]
        return any(all(_same(name, value, settings) for name, value in told.items()) for settings in known)

    @cached_property
    def reply_timeouts(self) -> tuple[Limit, ...]:
        """How long a master waits for a reply that does not come."""
        return (self._limit("reply_timeout_s"),)

    @cached_property
    def turnarounds(self) -> tuple[Limit, ...]:
        """From the end of a reply of this drive to the next request of anybody."""
        needed = (Limit(self.needs_pause_s, SET_HERE),) if self.needs_pause_s else ()
        own = self._limit("turnaround_s"), self._limit("least_turnaround_s")
        return (*needed, *own, self._limit("turnaround_characters"))

    @cached_property
    def broadcast_pauses(self) -> tuple[Limit, ...]:
        """From the end of a broadcast to the next request."""
        return self._limit("broadcast_pause_s"), self._limit("turnaround_characters")

    @cached_property
    def intervals(self) -> tuple[Limit, ...]:
        """From the beginning of a request to this drive to the beginning of the next one."""
        return (self._limit("request_interval_s"),)

    @cached_property
    def gap(self) -> Limit:
        """The longest pause inside a telegram."""
        gaps = [self._limit("gap_s"), self._limit("gap_characters")]
        if self.silence_characters:
            silence_s = self.facts.settings.wire_s(self.silence_characters)
            silence = Limit(silence_s, self.sources.get("silence_characters", ""))
            # A gap that was chosen for this drive goes before its protocol's silence.
            gaps = [max(silence, gaps[0])] if gaps[0].source == SET_HERE else [silence]
        return max(gaps)

    def _limit(self, fact: str) -> Limit:
        value = float(getattr(self.facts.timing, fact))
        seconds = self.facts.settings.wire_s(value) if fact.endswith("_characters") else value
        return Limit(seconds, self.sources.get(fact, ""))


def _same(name: str, told: object, settings: LineSettings) -> bool:
    own = getattr(settings, name)
    # A terminal knows one stop bit or more.
    return bool(told == own or (name == "stopbits" and told == 2 and own == 1.5))


def reads_as(codec: Codec) -> Hashable:
    """Return what is equal for codecs that read alike, so that only one of them is asked."""
    known: Hashable = getattr(codec, "alike", type(codec))
    return known


def in_ms(seconds: float) -> str:
    """Return a time as people read it: 6.3 ms."""
    return f"{seconds * 1000:.3g} ms" if seconds < 0.9995 else f"{seconds:.4g} s"
