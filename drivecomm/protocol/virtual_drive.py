"""What a protocol package's virtual drive is: it answers on a virtual line as the manual says a real one does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from drivecomm.protocol.framing import Codec, Damaged, Framed
    from drivecomm.protocol.line import LineSettings
    from drivecomm.protocol.motor import Motor


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualReply:
    """What a virtual drive sends, and how long after the request's last character it begins."""

    data: bytes
    delay_s: float


class VirtualDrive(Protocol):
    """A drive that answers as the manual says a real one does. It hears whole telegrams and damaged ones.

    It may have four methods besides, each of a time: `follow(now)` lets time pass, so that a watchdog acts when nobody
    asks; `overhear(now)` takes note of a sound telegram to another drive; `mishear(now)` takes note of characters that
    are no telegram to it; `power_cycle(now)` switches mains off and on. `shared_addresses` are those at which it obeys
    and does not answer, unless that is the protocol's `broadcast_address` alone.
    """

    address: int
    settings: LineSettings
    gap_s: float
    motor: Motor

    @property
    def codec(self) -> Codec:
        """The telegrams that this drive understands."""

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a request of this protocol heard on the line at this time; None is silence."""

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what the drive holds, as `Reading.raw` would show it. Raises ParameterAddressError."""

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what the drive holds, as if at its keypad: no access check. Raises ParameterAddressError.

        ValueError is raised for a number that has no room there, so that whatever is taken can be read.
        """

    def trip(self, code: int, now: float) -> None:
        """Make the drive trip with this fault code."""


@runtime_checkable
class Refuses(Protocol):
    """What a virtual drive has besides if it can be told to refuse a request with any code of its protocol."""

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request to this drive, with all that a refusal leaves behind in it, and change nothing else.

        None for a request that no drive of the protocol refuses, such as one without a parameter.
        """
