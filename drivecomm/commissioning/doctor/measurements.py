"""Measurements of a port and its line: taken by `measuring`, judged by `findings`."""

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
class NoiseRecord:
    """Bytes received unasked within some seconds. telegrams: number of sound telegrams among them, by protocol."""

    settings: LineSettings
    seconds: float
    data: bytes
    telegrams: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoTrial:
    """Bytes that came back for a few bytes that no drive answers. took_s: seconds from sending to the last byte."""

    sent: bytes
    came: bytes
    took_s: float = 0.0

    @property
    def kind(self) -> EchoKind:
        """Kind of echo: nothing came back, all of the bytes, or different bytes."""
        if not self.came:
            return "none"
        return "whole" if self.sent in self.came else "changed"


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchedDrive:
    """Result of a search for an expected drive at its own settings.

    error: why the drive counts as silent; empty if it answers. elsewhere: the settings at which it answers instead.
    needs: options with which it answers. answered_by: the address from which a reply came instead. came: received bytes
    that are not a reply of this drive.
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
    """Replies of one drive to a series of probes.

    asked: number of probes. times_s: seconds from sending a request to the end of its reply. wire_s: transmission time
    of the characters within each of these. arrivals_s: arrival times of the replies. noise: bytes around replies that
    belong to no reply. damaged: replies that were not sound. damage: their probable cause. needs: options with which
    the drive answers every time, if it fails without them.
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
        """Seconds of each reply beyond its transmission time: the delay of the drive and of the adapter."""
        return [time - wire for time, wire in zip(self.times_s, self.wire_s, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """All measurements of one port and its line.

    asked: the protocols, with the settings used for their requests. unclear_bytes: bytes received during requests that
    belong to no answer. elsewhere: drives that answer only at another baud rate, with its settings, or only with more
    time, with the original settings. sought: the expected drives; with these, `found` has only other drives. panel:
    settings that drives of the plant report of their panels. carries_settings: whether the line really uses the
    requested line settings.
    """

    paced: bool
    echo_said: Echo
    noise: Sequence[NoiseRecord]
    echo: Sequence[EchoTrial]
    asked: Mapping[str, LineSettings]
    addresses: int
    found: Sequence[Found]
    replies: Sequence[Replies]
    unclear_bytes: int
    elsewhere: Sequence[tuple[Found, LineSettings]]
    sought: Sequence[SearchedDrive] = ()
    panel: Sequence[PanelReading] = ()
    carries_settings: bool = True
