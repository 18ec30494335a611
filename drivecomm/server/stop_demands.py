"""Stop demands: stops that a door holds as a level, such as a PLC does with a register, until it releases them.

While one is held, no door starts the drive, and a drive that is seen running is stopped again. Requests over HTTP,
MQTT, Sparkplug and OPC UA are events and hold nothing: their stops stand only until they are confirmed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.errors import LeaseError
from drivecomm.link import Backoff
from drivecomm.server.observations import StandingStop

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.protocol import Stop
    from drivecomm.server.table import ValueTable

AGAIN_FIRST_S, AGAIN_LONGEST_S = 1.0, 10.0
"""First and longest pause between stops of a drive that still runs: it may be ramping down, or started by others."""


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    who: str
    how: Stop
    since_s: float = field(default_factory=time.time)


@dataclass(slots=True, eq=False)
class _Demand:
    """The stop demand on one drive.

    held: its holds, the oldest first. stood: the drive was seen at rest since then. against: it was seen running after
    that.
    """

    held: tuple[_Held, ...] = ()
    stood: bool = False
    against: bool = False
    again: Backoff = field(default_factory=lambda: Backoff(AGAIN_FIRST_S, AGAIN_LONGEST_S))


class StopDemands:
    """The stop demands of a plant, by the names of its drives.

    send: sends a stop, and retries it until it is confirmed. clock: a monotonic clock. Used from the core's event loop;
    `of` and `drives` from any thread.
    """

    def __init__(
        self, table: ValueTable, send: Callable[[str, Stop, str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._table, self._send, self._clock = table, send, clock
        self._demands: dict[str, _Demand] = {}

    def hold(self, drive: str, how: Stop, who: str) -> Callable[[], None]:
        """Demand that a drive stay stopped until the returned function is called; the caller sends the stop itself."""
        held = _Held(who, how)
        # Stored only with its first hold, because other threads read it and expect one.
        demand = self._demands.get(drive) or _Demand()
        demand.held = (*demand.held, held)
        self._demands[drive] = demand
        demand.again.failed(self._clock())

        def release() -> None:
            rest = tuple(each for each in demand.held if each is not held)
            if rest:
                demand.held = rest
            elif self._demands.get(drive) is demand:
                del self._demands[drive]

        return release

    @property
    def drives(self) -> Sequence[str]:
        """The drives with a stop demand."""
        return tuple(self._demands)

    def of(self, drive: str, stands: StandingStop | None) -> StandingStop | None:
        """Return the demanded stop of a drive; without a demand, its standing stop `stands`."""
        demand = self._demands.get(drive)
        if demand is None:
            return stands
        first = demand.held[0]
        return StandingStop(
            how=first.how,
            who=first.who,
            since_s=first.since_s,
            confirmed=stands is None and not demand.against,
            demanded=True,
        )

    def check(self, drive: str) -> None:
        """Raise LeaseError if a drive must not be started, because its stop is demanded."""
        demand = self._demands.get(drive)
        if demand is not None:
            raise LeaseError(
                f"{drive} is not started while a stop of it is demanded by {demand.held[0].who}; release it there first"
            )

    def seen(self, drive: str, *, running: bool) -> None:
        """Record whether a drive runs; if it runs although its stop is demanded, send another stop."""
        demand = self._demands.get(drive)
        if demand is None:
            return
        if not running:
            demand.stood, demand.against = True, False
            demand.again.succeeded()
            return
        was_started = demand.stood
        if not was_started and self._clock() < demand.again.over_at:
            return
        demand.stood, demand.against = False, demand.against or was_started
        demand.again.failed(self._clock())
        latest = demand.held[-1]
        if was_started:
            text = f"runs although a stop is demanded; stop ({latest.how.value}) sent again"
            self._table.record_event("warning", text, drive=drive, who=latest.who)
        self._send(drive, latest.how, latest.who)
