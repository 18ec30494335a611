"""Locks on drives, as OPC 10000-100 has them: each is a lease of the server's, and ends with its session.

The methods return 0 when it was done; -1 where somebody else has the lock, or nobody; -2 where it cannot be had.
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
    from drivecomm.server.opcua.asking import Asking, Session

DONE, NOT_FREE, REFUSED = 0, -1, -2

_log = logging.getLogger("drivecomm.server")


@dataclass(frozen=True, slots=True)
class _Held:
    session: Session
    caller: Caller
    key: str


class Locks:
    """The locks of the sessions of one door."""

    def __init__(self, plant: ServedPlant) -> None:
        self._plant = plant
        self._held: dict[str, _Held] = {}

    def key(self, session: Session, drive: str) -> str:
        """Return the key of the lease that a session has locked a drive by, empty where it has not.

        One that is over stays the session's until it says otherwise: it must not command without knowing.
        """
        held = self._held.get(drive)
        return held.key if held is not None and held.session is session else ""

    async def init(self, now: Asking, drive: str) -> tuple[int, str]:
        """Lock a drive for a session."""
        if now.waited_s > VALID_S:
            return REFUSED, "the call was on its way for too long"
        try:
            lease = await self._plant.take_lease(now.session.caller, drive, LOCK_S)
        except LeaseError as error:
            return NOT_FREE, in_one_line(error)
        except DriveCommError as error:
            return REFUSED, in_one_line(error)
        held = _Held(now.session, now.session.caller, lease.key)
        if now.session.over:
            # It went while it was being given what it asked for.
            await self._give_back(drive, held)
            return REFUSED, "the session is over"
        self._held[drive] = held
        return DONE, ""

    async def renew(self, now: Asking, drive: str) -> tuple[int, str]:
        """Have a lock for longer."""
        held = self._held.get(drive)
        if held is None or held.session is not now.session:
            return NOT_FREE, f"this session has not locked {drive}"
        if now.waited_s > VALID_S:
            return REFUSED, "the call was on its way for too long"
        try:
            await self._plant.renew_lease(held.caller, drive, held.key, LOCK_S)
        except DriveCommError as error:
            return NOT_FREE, in_one_line(error)
        return DONE, ""

    async def end(self, now: Asking, drive: str) -> tuple[int, str]:
        """Give a lock back."""
        held = self._held.get(drive)
        if held is None or held.session is not now.session:
            return NOT_FREE, f"this session has not locked {drive}"
        del self._held[drive]
        return await self._give_back(drive, held)

    async def break_(self, now: Asking, drive: str) -> tuple[int, str]:
        """End the lock of another session of this door; whose motor it kept is treated by its link-loss policy."""
        if now.session.caller.role < Role.COMMISSION:
            return REFUSED, "breaking a lock is for users with the role commission"
        held = self._held.get(drive)
        if held is None:
            return NOT_FREE, f"no session of this door has locked {drive}"
        # It stays the other session's, which must find out.
        return await self._give_back(drive, held)

    async def session_ended(self, session: Session) -> None:
        """Give back all that a session had."""
        for drive, held in list(self._held.items()):
            if held.session is session:
                del self._held[drive]
                await self._give_back(drive, held)

    async def _give_back(self, drive: str, held: _Held) -> tuple[int, str]:
        try:
            await self._plant.end_lease(held.caller, drive, held.key)
        except DriveCommError as error:
            # It was over already.
            _log.debug("giving back the lock of %s: %s", drive, error)
            return NOT_FREE, in_one_line(error)
        return DONE, ""
