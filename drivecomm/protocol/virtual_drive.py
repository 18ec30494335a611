"""Interface of virtual drives, which answer on a virtual line as the manual says a real drive does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from drivecomm.protocol.framing import Codec, Damaged, Framed
    from drivecomm.protocol.line import LineSettings
    from drivecomm.protocol.motor import Motor


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualReply:
    """Bytes that a virtual drive sends, and the delay from the request's last character to the first of them."""

    data: bytes
    delay_s: float


class VirtualDrive(Protocol):
    """A drive that answers as the manual says a real one does. It receives whole and damaged telegrams.

    It may have four further methods, each with the time as its argument. `follow(now)` lets time pass, so that a
    watchdog acts without requests. `overhear(now)` registers a sound telegram to another drive. `mishear(now)`
    registers characters that are not a telegram to this drive. `power_cycle(now)` switches mains off and on.
    `shared_addresses` are the addresses at which the drive obeys and does not answer, unless this is only the
    protocol's `broadcast_address`.
    """

    address: int
    settings: LineSettings
    gap_s: float
    motor: Motor

    @property
    def codec(self) -> Codec:
        """Codec of the telegrams that this drive understands."""

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a request of this protocol that arrived at this time; return None for no reply."""

    def peek(self, parameter: str, now: float) -> int | str:
        """Return the value of a parameter in the form of `Reading.raw`. Raises ParameterAddressError."""

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set the value of a parameter as if at the keypad: no access check. Raises ParameterAddressError.

        Raises ValueError for a number that the parameter cannot hold, so that every accepted value can be read.
        """

    def trip(self, code: int, now: float) -> None:
        """Make the drive trip with this fault code."""


@runtime_checkable
class Refuses(Protocol):
    """Further method of a virtual drive that can refuse a request with any code of its protocol."""

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request to this drive, with all effects that a refusal has in it, and change nothing else.

        None for a request that no drive of the protocol refuses, such as one without a parameter.
        """
