"""Locks on drives, as in OPC 10000-100: each is a lease of the server and ends with its session.

The methods return 0 on success, -1 if the lock belongs to another session or to none, and -2 if it is refused.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, LeaseError, in_one_line
from drivecomm.server import Role
from drivecomm.server.opcua.limits import LOCK_S, VALID_S

if TYPE_CHECKING:
    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.opcua.active_request import ActiveRequest, CallingSession

DONE, NOT_FREE, REFUSED = 0, -1, -2

_log = logging.getLogger("drivecomm.server")


@dataclass(frozen=True, slots=True)
class _Held:
    session: CallingSession
    caller: Caller
    key: str


class Locks:
    """Locks held by the sessions of one door."""

    def __init__(self, plant: ServedPlant) -> None:
        self._plant = plant
        self._held: dict[str, _Held] = {}

    def key(self, session: CallingSession, drive: str) -> str:
        """Return the key of the lease by which a session has locked a drive; "" without a lock.

        An expired lock stays with its session until the session ends it, so that the session notices and cannot command
        without a lease.
        """
        held = self._held.get(drive)
        return held.key if held is not None and held.session is session else ""

    async def init(self, now: ActiveRequest, drive: str) -> tuple[int, str]:
        """Lock a drive for a session."""
        if now.waited_s > VALID_S:
            return REFUSED, "the call took too long to arrive"
        try:
            lease = await self._plant.take_lease(now.session.caller, drive, LOCK_S)
        except LeaseError as error:
            return NOT_FREE, in_one_line(error)
        except DriveCommError as error:
            return REFUSED, in_one_line(error)
        held = _Held(now.session, now.session.caller, lease.key)
        if now.session.over:
            # The session ended while the lease was being acquired.
            await self._give_back(drive, held)
            return REFUSED, "the session has ended"
        self._held[drive] = held
        return DONE, ""

    async def renew(self, now: ActiveRequest, drive: str) -> tuple[int, str]:
        """Renew a lock."""
        held = self._held.get(drive)
        if held is None or held.session is not now.session:
            return NOT_FREE, f"this session has not locked {drive}"
        if now.waited_s > VALID_S:
            return REFUSED, "the call took too long to arrive"
        try:
            await self._plant.renew_lease(held.caller, drive, held.key, LOCK_S)
        except DriveCommError as error:
            return NOT_FREE, in_one_line(error)
        return DONE, ""

    async def end(self, now: ActiveRequest, drive: str) -> tuple[int, str]:
        """Release a lock."""
        held = self._held.get(drive)
        if held is None or held.session is not now.session:
            return NOT_FREE, f"this session has not locked {drive}"
        del self._held[drive]
        return await self._give_back(drive, held)

    async def break_(self, now: ActiveRequest, drive: str) -> tuple[int, str]:
        """End the lock of another session of this door; the link-loss policy of a motor kept under it is applied."""
        if now.session.caller.role < Role.COMMISSION:
            return REFUSED, "breaking a lock is for users with the role commission"
        held = self._held.get(drive)
        if held is None:
            return NOT_FREE, f"no session of this door has locked {drive}"
        # The entry stays with the other session, which must notice the loss.
        return await self._give_back(drive, held)

    async def session_ended(self, session: CallingSession) -> None:
        """Release all locks of a session."""
        for drive, held in list(self._held.items()):
            if held.session is session:
                del self._held[drive]
                await self._give_back(drive, held)

    async def _give_back(self, drive: str, held: _Held) -> tuple[int, str]:
        try:
            await self._plant.end_lease(held.caller, drive, held.key)
        except DriveCommError as error:
            # The lease had already expired.
            _log.debug("releasing the lock of %s: %s", drive, error)
            return NOT_FREE, in_one_line(error)
        return DONE, ""
