"""What was measured of a port and its line: made by `measuring`, judged by `findings`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.bus import Found
    from drivecomm.commissioning.doctor.panel import PanelReading
    from drivecomm.link import Damage, Echo
    from drivecomm.protocol import DriveConfig, LineSettings

EchoKind: TypeAlias = Literal["none", "whole", "changed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """What came within some seconds unasked. telegrams: how many sound ones of which protocols were among it."""

    settings: LineSettings
    seconds: float
    data: bytes
    telegrams: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoTrial:
    """What came back of a few bytes that nobody answers. took_s: from sending to the last byte's coming."""

    sent: bytes
    came: bytes
    took_s: float = 0.0

    @property
    def kind(self) -> EchoKind:
        """Whether nothing came back, all of it, or something else."""
        if not self.came:
            return "none"
        return "whole" if self.sent in self.came else "changed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sought:
    """What came of asking for an expected drive at its own settings.

    error: why it is taken not to answer, empty when it does. elsewhere: the settings at which it answers instead.
    needs: options with which it answers. answered_by: the address that a reply came from instead. came: what was
    received that is not a reply of it.
    """

    drive: DriveConfig
    settings: LineSettings
    error: str = ""
    elsewhere: LineSettings | None = None
    needs: Mapping[str, float] = field(default_factory=dict)
    answered_by: int | None = None
    came: Sequence[bytes] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Replies:
    """How one drive answers a number of probes.

    asked: how many. times_s: from the sending of a request to the end of its reply. wire_s: how much of each is the
    time of the characters. arrivals_s: when the replies came. noise: bytes around replies that belong to none. damaged:
    replies that were not sound. damage: what probably happened to them. needs: options with which the drive answers
    every time, if it does not without them.
    """

    drive: str
    settings: LineSettings
    reply_timeout_s: float
    asked: int
    times_s: Sequence[float]
    wire_s: Sequence[float]
    arrivals_s: Sequence[float]
    noise: Sequence[bytes] = ()
    damaged: Sequence[bytes] = ()
    damage: Damage | None = None
    needs: Mapping[str, float] = field(default_factory=dict)

    @property
    def delays_s(self) -> list[float]:
        """What each reply took beyond its characters: the drive's own time, and the adapter's."""
        return [time - wire for time, wire in zip(self.times_s, self.wire_s, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """All that was measured.

    asked: the protocols and the settings they were asked at. unclear_bytes: what came while asking and was part of no
    answer. elsewhere: drives that answer only at another baud rate, with the settings, or only with more time, with the
    settings they were asked at. sought: the drives that are said
    to be there; found are then others. panel: what drives of the plant say of the settings of their panels.
    carries_settings: whether line settings asked for here are those of the line.
    """

    paced: bool
    echo_said: Echo
    noise: Sequence[Listening]
    echo: Sequence[EchoTrial]
    asked: Mapping[str, LineSettings]
    addresses: int
    found: Sequence[Found]
    replies: Sequence[Replies]
    unclear_bytes: int
    elsewhere: Sequence[tuple[Found, LineSettings]]
    sought: Sequence[Sought] = ()
    panel: Sequence[PanelReading] = ()
    carries_settings: bool = True
