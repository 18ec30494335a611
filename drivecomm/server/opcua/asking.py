"""Who is asking just now: the session whose request is being served, for methods, which asyncua does not tell it."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Caller
    from drivecomm.server.opcua.monitored import Items


class Session(Protocol):
    """What methods know of a session. client: what its program calls itself. over: whether it has ended."""

    client: str
    over: bool

    @property
    def caller(self) -> Caller:
        """Who has logged in."""

    def own_items(self) -> Mapping[int, Items]:
        """Return what its subscriptions listen to, by their numbers."""


@dataclass(frozen=True, slots=True)
class Asking:
    """A request under way. waited_s: how long it was on its way and in our own queues."""

    session: Session
    waited_s: float


asking: ContextVar[Asking] = ContextVar("asking")
