"""Rules for every kept motor and every keeper: policies, the stop on leaving, times and repetitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, get_args

from drivecomm.errors import NotSupported, UsageError
from drivecomm.protocol import LinkLoss, Stop

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.bus.verbs import DriveVerbs

USUAL_WATCHDOG_S = 5
"""Time of the drive's watchdog in seconds, unless one is given."""

REFRESHES_IN_TIME = 3
"""Number of refreshes within the time of a watchdog or lease, so that one lost telegram does no harm."""

STOP_TRIES = 3
"""Number of immediate attempts to stop a motor on leaving, before the error is raised."""

SHORTEST_LEASE_S = 2.0
"""Shortest lease under which a server keeps a motor, in seconds."""

LONGEST_LEASE_S = 30.0
"""Longest lease that a server gives, in seconds; keeping a motor for longer needs renewals."""

# A trip cannot be commanded, so the motor is stopped as gently as possible.
_STOPS: dict[LinkLoss, Stop | None] = {"hold": None, "ramp": Stop.RAMP, "coast": Stop.COAST, "trip": Stop.RAMP}


def stop_on_leaving(drive: DriveVerbs[Any], policy: LinkLoss, on_leaving: LinkLoss | None) -> Stop | None:
    """Return the stop that is sent on leaving; None if none is sent.

    Raises UsageError for an unknown policy, NotSupported for a stop that the drive does not have.
    """
    for given in (policy, on_leaving or policy):
        if given not in get_args(LinkLoss):
            *some, last = get_args(LinkLoss)
            raise UsageError(f"unknown policy {given!r}; use {', '.join(some)} or {last}")
    stop = _STOPS[on_leaving or policy]
    if stop is not None and stop not in drive.capabilities.stops:
        able = ", ".join(sorted(stop.value for stop in drive.capabilities.stops))
        raise NotSupported(f"{drive.name} cannot stop by {stop.value} when it is left; it can by {able}")
    return stop


def lease_s(watchdog_s: Decimal | float) -> float:
    """Return the length in seconds of the lease for a watchdog time: the same, within the limits of leases."""
    return min(LONGEST_LEASE_S, max(SHORTEST_LEASE_S, float(watchdog_s)))
