"""What a link yields to its runner, and what it is resumed with. It never sleeps and never reads a clock."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

T = TypeVar("T")


class Configure(NamedTuple):
    """Set the port to these line settings."""

    settings: LineSettings


class Send(NamedTuple):
    """Write these bytes."""

    data: bytes


class Receive(NamedTuple):
    """Wait for bytes until this time; return early only with at least this many.

    gives_way: return early, too, when a stop waits for the line.
    """

    until: float
    at_least: int = 1
    gives_way: bool = False


class Wait(NamedTuple):
    """Let time pass until then. gives_way: return early when a stop waits for the line."""

    until: float
    gives_way: bool = False


Effect: TypeAlias = Configure | Send | Receive | Wait


class Arrival(NamedTuple):
    """The time, the bytes that came (for Receive), and what the port says of its settings (for Configure)."""

    time: float
    data: bytes = b""
    note: str = ""


Steps: TypeAlias = Generator[Effect, Arrival, T]
