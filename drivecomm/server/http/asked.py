"""One request of the API, as what carries it out sees it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.requests import Request

    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.http.guard import LoginRate
    from drivecomm.server.http.metrics import Metrics
    from drivecomm.server.http.stream import Streams


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorState:
    """What belongs to one door that is open."""

    plant: ServedPlant
    streams: Streams
    logins: LoginRate
    metrics: Metrics
    rendering: asyncio.Lock = field(default_factory=asyncio.Lock)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """A request that was understood.

    caller: who asks. path: what the address names, by the words in the route. given: the fields of body or query.
    """

    door: DoorState
    request: Request
    caller: Caller
    path: Mapping[str, str]
    given: Mapping[str, Any] = field(default_factory=dict)

    @property
    def plant(self) -> ServedPlant:
        """The plant that is asked about."""
        return self.door.plant
