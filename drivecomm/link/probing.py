"""Probing of silent drives: when a drive is given up, and how it is tried again now and then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import NoReplyError, NotAnsweringError, ReplyError
from drivecomm.link.exchange_loop import carry_out
from drivecomm.link.health import PROBE_S, ProbingTime

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link.call_context import CallContext
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import DriveRecord, Peer
    from drivecomm.link.port import LinkSteps
    from drivecomm.protocol import Exchange


class Probing:
    """Prober of the silent drives of one line. records: records of all drives of the line, by name."""

    def __init__(self, line: LineState, records: dict[str, DriveRecord]) -> None:
        self._line = line
        self._records = records
        self._took_s = PROBE_S

    def fell_silent(self, peer: Peer, record: DriveRecord, began: float) -> None:
        """Record that a call which began at `began` got no reply; the drive may be given up because of it."""
        line = self._line
        if record.health.fell_silent(began, line.now, self._time().least_pause_s(self._took_s)):
            line.note(peer, "note", detail="does not answer; it is probed now and then")
            line.away(peer.name)

    def probe(self, call: CallContext, probe: Callable[[], Exchange[None]]) -> LinkSteps[None]:
        """Probe a drive that was given up. Raises NotAnsweringError if the probe is not due yet, or gets no reply."""
        line, peer, record = self._line, call.peer, call.record
        health, began = record.health, line.now
        silent = f"{peer.name} has not answered for {began - health.silent_since:.1f} s"
        if began < health.probe_at:
            raise NotAnsweringError(f"{silent}; it is probed again in {health.probe_at - began:.1f} s")
        time = self._time()
        if not health.patient:
            call.listen_until = began + time.each_s
        health.patient = False
        record.count["probes"] += 1
        try:
            yield from carry_out(call, probe())
        except ReplyError as error:
            something_came = health.patient
            self._took_s = line.now - began
            health.fell_silent(began, line.now, time.least_pause_s(self._took_s))
            if something_came:
                health.heard_late()
            elif call.listen_until is not None:
                line.probed = record
            if not isinstance(error, NoReplyError):
                raise
            raise NotAnsweringError(f"{silent}; it was probed just now") from error
        finally:
            call.listen_until = None

    def _time(self) -> ProbingTime:
        # Other threads add drives at any time; making a copy is one atomic step.
        return ProbingTime(each.health for each in self._records.copy().values())
