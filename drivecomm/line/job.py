"""Job: an exchange with a drive, and its urgency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from drivecomm.line.queue import Rank

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import CommandCall, Peer
    from drivecomm.protocol import Exchange

T = TypeVar("T")


class Job(NamedTuple, Generic[T]):
    """An exchange with a drive, or with all drives of a protocol, that the bus carries out.

    command: the command call that a later stop cancels. insists: whether to send even to a drive that is known to be
    silent. again: makes the exchange anew, for a stop that lets other calls use the line
    between its attempts.
    """

    peer: Peer
    exchange: Exchange[T]
    rank: Rank = Rank.READ
    command: CommandCall | None = None
    insists: bool = False
    again: Callable[[], Exchange[T]] | None = None
