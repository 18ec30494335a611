"""Rules that a master must keep on a line, for each drive, and violations of them."""

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
"""Name of a rule for the master."""

RULES: tuple[Rule, ...] = get_args(Rule)
"""Names of all rules."""

DEFAULT = "a default of drivecomm"
"""Source of a value that no manual demands."""

SET_HERE = "set for this drive"
"""Source of a value that was given with the drive."""


class TimeLimit(NamedTuple):
    """A limit in seconds, and the source that demands it; an empty source for a default of drivecomm."""

    seconds: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A violation of a rule by a master, at a time of the line's clock in seconds.

    measured, allowed: seconds, or line settings as text. source: manual and page of the allowed value. demanded: True
    if the manufacturer or the settings of the drive demand that value, which makes this a failure; False for a default
    of drivecomm, which makes it a note. drive: such as "vabus:1". tolerance_s: part of the measured time that is
    attributed to the measuring process. `str()` gives one sentence.
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
    """Rules that a master must keep with one drive.

    name: name of the drive, for people. codec: its telegrams. facts: its line settings, and the timing of its master.
    silence_characters: length of the pause inside a telegram that ends it, in characters; 0 if `gap_s` of the facts
    counts. sources: for each demanded value, its source, by the name of the fact; the other values are defaults of
    drivecomm. needs_pause_s: seconds after its reply during which the drive misses a new request. settings_now: returns
    the present line settings of the drive, if a parameter or a reset may have changed them.
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
    def reply_timeouts(self) -> tuple[TimeLimit, ...]:
        """Limits for the wait of a master for a missing reply."""
        return (self._limit("reply_timeout_s"),)

    @cached_property
    def turnarounds(self) -> tuple[TimeLimit, ...]:
        """Limits for the time from the end of a reply of this drive to the next request to any drive."""
        needed = (TimeLimit(self.needs_pause_s, SET_HERE),) if self.needs_pause_s else ()
        own = self._limit("turnaround_s"), self._limit("least_turnaround_s")
        return (*needed, *own, self._limit("turnaround_characters"))

    @cached_property
    def broadcast_pauses(self) -> tuple[TimeLimit, ...]:
        """Limits for the time from the end of a broadcast to the next request."""
        return self._limit("broadcast_pause_s"), self._limit("turnaround_characters")

    @cached_property
    def intervals(self) -> tuple[TimeLimit, ...]:
        """Limits for the time from the beginning of one request to this drive to the beginning of the next."""
        return (self._limit("request_interval_s"),)

    @cached_property
    def gap(self) -> TimeLimit:
        """The longest pause inside a telegram."""
        gaps = [self._limit("gap_s"), self._limit("gap_characters")]
        if self.silence_characters:
            silence_s = self.facts.settings.wire_s(self.silence_characters)
            silence = TimeLimit(silence_s, self.sources.get("silence_characters", ""))
            # A gap chosen for this drive overrides its protocol's silence.
            gaps = [max(silence, gaps[0])] if gaps[0].source == SET_HERE else [silence]
        return max(gaps)

    def _limit(self, fact: str) -> TimeLimit:
        value = float(getattr(self.facts.timing, fact))
        seconds = self.facts.settings.wire_s(value) if fact.endswith("_characters") else value
        return TimeLimit(seconds, self.sources.get(fact, ""))


def _same(name: str, told: object, settings: LineSettings) -> bool:
    own = getattr(settings, name)
    # A terminal reports one stop bit or two; two also stands for one and a half.
    return bool(told == own or (name == "stopbits" and told == 2 and own == 1.5))


def codec_key(codec: Codec) -> Hashable:
    """Return a key that is equal for codecs that decode alike, so that only one of them is used."""
    known: Hashable = getattr(codec, "alike", type(codec))
    return known


def in_ms(seconds: float) -> str:
    """Return a time as text, such as 6.3 ms."""
    return f"{seconds * 1000:.3g} ms" if seconds < 0.9995 else f"{seconds:.4g} s"
