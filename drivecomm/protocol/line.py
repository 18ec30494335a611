"""Settings and timing of a serial line."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal, TypeAlias, get_args

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol.argument_types import is_duration, is_number

Parity: TypeAlias = Literal["N", "E", "O", "M", "S"]
"""N: none. E: even. O: odd. M: mark. S: space."""

USUAL_BAUD_RATES = (9600, 19200, 38400, 4800, 57600, 115200, 2400, 1200)
"""Baud rates to which drives are set, the most usual first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSettings:
    """Speed and character format of a serial line, for example 9600 baud 8E1.

    baudrate: bits per second. bytesize: data bits, 7 or 8. parity: N, E, O, M or S. stopbits: 1, 1.5 or 2.
    """

    baudrate: int = 9600
    bytesize: int = 8
    parity: Parity = "N"
    stopbits: float = 1

    def __post_init__(self) -> None:
        if type(self.baudrate) is not int or not 50 <= self.baudrate <= 4_000_000:
            raise UsageError(f"a baud rate of {shortened(self.baudrate)} is not between 50 and 4000000")
        if type(self.bytesize) is not int or self.bytesize not in (7, 8):
            raise UsageError(f"{shortened(self.bytesize)} data bits are not possible, drives use 7 or 8")
        if self.parity not in get_args(Parity):
            raise UsageError(f"parity {shortened(self.parity)} is not one of N, E, O, M, S")
        if type(self.stopbits) not in (int, float) or self.stopbits not in (1, 1.5, 2):
            raise UsageError(f"{shortened(self.stopbits)} stop bits are not possible, use 1, 1.5 or 2")

    @property
    def character_s(self) -> float:
        """Seconds that one character takes: start bit, data bits, parity bit, stop bits."""
        return (1 + self.bytesize + (self.parity != "N") + self.stopbits) / self.baudrate

    def wire_s(self, characters: float) -> float:
        """Return the seconds that a number of characters take when they follow each other without a gap."""
        return characters * self.character_s

    def __str__(self) -> str:
        return f"{self.baudrate} {self.bytesize}{self.parity}{self.stopbits:g}"


SETTING_NAMES = tuple(field.name for field in fields(LineSettings))
"""The names of line settings, in the order of `LineSettings`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Timing rules of a master, in seconds unless the name says otherwise.

    - reply_timeout_s: from the last character of a request to the first of the reply.
    - gap_s: the longest pause inside a telegram; a longer one ends the telegram.
    - turnaround_s: from the end of a reply to the next request.
    - broadcast_pause_s: from the end of a broadcast to the next request.
    - gap_characters, turnaround_characters: the same in character times; the longer of both applies.
      turnaround_characters also applies after a broadcast.
    - late_s: time after an unanswered request during which its reply may still arrive.
    - attempts: maximum number of times that a request is sent, if repeating it is safe.
    - request_interval_s: from the start of a request to this drive to the start of the next request to it.
    - deadline_s: maximum duration of one call, including waiting in the queue and all attempts.
    - tuned_turnaround_s: a shorter turnaround that was measured with this drive and is used until errors rise; 0 for
      none.
    - least_turnaround_s, least_reply_timeout_s: minimum that the maker demands; tuning never goes below it.
    """

    reply_timeout_s: float
    gap_s: float
    turnaround_s: float
    broadcast_pause_s: float
    gap_characters: float = 0.0
    turnaround_characters: float = 0.0
    late_s: float = 1.0
    attempts: int = 3
    request_interval_s: float = 0.0
    deadline_s: float = 30.0
    tuned_turnaround_s: float = 0.0
    least_turnaround_s: float = 0.0
    least_reply_timeout_s: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if is_number(value) and value < 0:
                raise UsageError(f"{field.name} of {shortened(value)} is negative", says=field.name)
            if not is_duration(value):
                raise UsageError(f"invalid {field.name} = {shortened(value)}; give a number", says=field.name)
        if type(self.attempts) is not int or self.attempts < 1:
            raise UsageError(
                f"attempts of {self.attempts} would never send anything, use a whole number of 1 or more",
                says="attempts",
            )
        if not self.reply_timeout_s:
            raise UsageError("reply_timeout_s of 0 leaves no time for a reply, use more", says="reply_timeout_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFacts:
    """Settings and timing of the line for one drive."""

    settings: LineSettings
    timing: Timing

    @property
    def gap_s(self) -> float:
        """The longest pause inside a telegram at this line's speed, in seconds."""
        return max(self.timing.gap_s, self.settings.wire_s(self.timing.gap_characters))

    @property
    def turnaround_s(self) -> float:
        """Seconds from the end of a reply to the next request at this line's speed, as tuned if that was done."""
        seconds = self.timing.tuned_turnaround_s or self.timing.turnaround_s
        return max(seconds, self.settings.wire_s(self.timing.turnaround_characters))

    @property
    def untuned(self) -> LineFacts:
        """The same facts without a tuned turnaround."""
        return self.override({"tuned_turnaround_s": 0.0}) if self.timing.tuned_turnaround_s else self

    @property
    def broadcast_pause_s(self) -> float:
        """The pause after a broadcast at this line's speed, in seconds."""
        return max(self.timing.broadcast_pause_s, self.settings.wire_s(self.timing.turnaround_characters))

    def override(self, facts: dict[str, object]) -> LineFacts:
        """Return a copy with the named facts replaced; the names are those of LineSettings and Timing.

        A fact given as None keeps its value. Raises UsageError for an invalid value.
        """
        known = {name: value for name, value in facts.items() if value is not None}
        settings = {name: known[name] for name in SETTING_NAMES if name in known}
        timing = {name: known[name] for name in _TIMING_NAMES if name in known}
        return LineFacts(
            settings=replace(self.settings, **settings),  # type: ignore[arg-type]
            timing=replace(self.timing, **timing),  # type: ignore[arg-type]
        )


_TIMING_NAMES = tuple(field.name for field in fields(Timing))
LINE_FACT_NAMES = frozenset((*SETTING_NAMES, *_TIMING_NAMES))
"""The names of all line facts, as keywords of `Bus.drive`."""
