"""Leases: the right to command a drive, held by one commander for a short time, renewed, and visible to all."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.bus import LONGEST_LEASE_S
from drivecomm.errors import LeaseError, UsageError, shortened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.server.callers import Caller


@dataclass(frozen=True, slots=True, kw_only=True)
class Lease:
    """The right to command one drive. until_s: in seconds since 1970. key: known only to its holder."""

    drive: str
    holder: Caller
    until_s: float
    key: str


class Leases:
    """The leases of all drives; used from one thread.

    now: time of a monotonic clock, by which leases expire. time_s: now, in seconds since 1970, to report the time of
    expiry.
    """

    def __init__(self) -> None:
        self._held: dict[str, tuple[Lease, float]] = {}
        self._replaced: list[Lease] = []

    def take(self, caller: Caller, drive: str, seconds: float, *, now: float, time_s: float, key: str = "") -> Lease:
        """Acquire the lease of a drive, or renew it if `key` is its key.

        Raises LeaseError while another caller holds it, including another program of the same user.
        """
        if self.holder_of(drive, now=now):
            return self.renew(caller, drive, key, seconds, now=now, time_s=time_s)
        new = Lease(drive=drive, holder=caller, until_s=0.0, key=secrets.token_urlsafe(16))
        return self._give(new, seconds, now, time_s)

    def renew(self, caller: Caller, drive: str, key: str, seconds: float, *, now: float, time_s: float) -> Lease:
        """Reset the remaining time of a lease. Raises LeaseError if it has expired or belongs to another caller."""
        return self._give(self._own(caller, drive, key, now), seconds, now, time_s)

    def end(self, caller: Caller, drive: str, key: str, *, now: float) -> Lease:
        """Release a lease and return it. Raises LeaseError if it has expired or belongs to another caller."""
        lease = self._own(caller, drive, key, now)
        del self._held[drive]
        return lease

    def release(self, lease: Lease) -> None:
        """Release a lease that was taken for one command, unless it has expired."""
        held = self._held.get(lease.drive)
        if held is not None and held[0].key == lease.key:
            del self._held[lease.drive]

    def forget(self, drive: str) -> None:
        """Drop the lease of a drive whose name means another drive from now on."""
        self._held.pop(drive, None)

    def admit(self, caller: Caller, drive: str, key: str, *, now: float) -> Lease | None:
        """Return the lease under which this caller may command the drive; None without a key for a free drive.

        Raises LeaseError while another caller holds it, or if the key is of an expired lease.
        """
        held = self.holder_of(drive, now=now)
        if held is None and not key:
            return None
        return self._own(caller, drive, key, now)

    def expire(self, now: float) -> Sequence[Lease]:
        """End all expired leases and return them, each once, including those already replaced by another lease."""
        ended = [lease for lease, until in self._held.values() if until <= now]
        for lease in ended:
            del self._held[lease.drive]
        ended[:0], self._replaced = self._replaced, []
        return ended

    def holder_of(self, drive: str, *, now: float) -> Lease | None:
        """Return the lease of a drive, or None if the drive is free."""
        lease, until = self._held.get(drive, (None, 0.0))
        return lease if now < until else None

    def all(self, *, now: float) -> Sequence[Lease]:
        """Return all leases; may be called from any thread."""
        # A copy, because other threads call this, too.
        return [lease for lease, until in list(self._held.values()) if now < until]

    def _own(self, caller: Caller, drive: str, key: str, now: float) -> Lease:
        lease = self.holder_of(drive, now=now)
        if lease is None:
            raise LeaseError(f"the lease of {drive} has expired; acquire it again")
        same = (lease.holder.name, lease.holder.door) == (caller.name, caller.door)
        if not same or not secrets.compare_digest(key.encode(errors="replace"), lease.key.encode()):
            seconds = self._held[drive][1] - now
            raise LeaseError(
                f"{drive} is commanded by {lease.holder} for another {max(seconds, 1):.0f} s"
                + (", by another program or page of the same user" if same else "")
            )
        return lease

    def _give(self, lease: Lease, seconds: float, now: float, time_s: float) -> Lease:
        if not isinstance(seconds, int | float) or not 0 < seconds <= LONGEST_LEASE_S:
            raise UsageError(f"invalid lease of {shortened(seconds)} s; give up to {LONGEST_LEASE_S:g} s, and renew it")
        given = replace(lease, until_s=time_s + seconds)
        before = self._held.get(lease.drive)
        if before is not None and before[0].key != lease.key:
            self._replaced.append(before[0])
        self._held[lease.drive] = given, now + seconds
        return given
