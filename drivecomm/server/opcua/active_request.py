"""Session of the request being served, for methods, to which asyncua does not pass it."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Caller
    from drivecomm.server.opcua.monitored import Items


class CallingSession(Protocol):
    """Session as seen by methods. client: application name of the client. over: whether the session has ended."""

    client: str
    over: bool

    @property
    def caller(self) -> Caller:
        """The logged-in caller."""

    def own_items(self) -> Mapping[int, Items]:
        """Return the monitored items of the session by subscription id."""


@dataclass(frozen=True, slots=True)
class ActiveRequest:
    """Request in progress. waited_s: seconds that it spent in transit and in our queues."""

    session: CallingSession
    waited_s: float


current_request: ContextVar[ActiveRequest] = ContextVar("asking")
