"""The sans-I/O link: it carries out exchanges with the drives of one line, as effects for a runner.

What does not stop a motor gives way to a stop that waits for the line: it sends nothing more, and what its drive has
not begun to answer within the time of one telegram is not waited for. It ends with OvertakenError.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import NoReplyError, NotAnsweringError, ReplyError
from drivecomm.link.asking import carry_out
from drivecomm.link.call import Call
from drivecomm.link.health import PROBE_S, Health, ProbingTime
from drivecomm.link.line_state import LineState
from drivecomm.link.peer import Peer, PeerState, TraceEvent

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Mapping

    from drivecomm.link.command_order import CommandCall
    from drivecomm.link.echo import Echo
    from drivecomm.link.port import Steps
    from drivecomm.link.statistics import Statistics
    from drivecomm.protocol import Exchange

T = TypeVar("T")


class Link:
    """One line. `run` turns an exchange with a drive into effects for a runner.

    echo: whether the adapter hands back what it sends. guard_s: quiet time after the line settings change, for
    receivers to settle. paced: whether characters take their time on this port, as on a real line; then nothing that
    comes before a request is out can answer it. stop_waits: tells whether a stop waits for the line. away: told the
    name of a drive that is given up, or that may have been without its line: what it was commanded holds no longer.
    """

    def __init__(
        self,
        *,
        trace: Callable[[TraceEvent], None] | None = None,
        echo: Echo = "off",
        guard_s: float = 0.005,
        away: Callable[[str], None] | None = None,
    ) -> None:
        self.paced = False
        self.stop_waits: Callable[[], bool] = _never
        self._line = LineState(trace, away, echo, guard_s)
        self._probe_took_s = PROBE_S
        # Threads that make drives add to it at any time: whoever goes through it takes a copy, which is one step.
        self._partners: dict[str, PeerState] = {}

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """What has happened, by the name of the drive."""
        return {name: partner.count for name, partner in self._partners.copy().items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """What has happened and how fast the drives answer, by the name of the drive."""
        return {name: partner.statistics for name, partner in self._partners.copy().items()}

    @property
    def health(self) -> Mapping[str, Health]:
        """Whether the drives answer, by name."""
        return {name: partner.health for name, partner in self._partners.copy().items()}

    def reopened(self) -> None:
        """Forget what held for the port before it was opened anew; all drives are set up again."""
        self._line.reopened()
        for name, partner in self._partners.copy().items():
            partner.health.away = True
            self._line.away(name)

    def must_set_up(self, peer: Peer) -> None:
        """Let this drive be set up before its next exchange."""
        self._partner(peer).health.away = True

    def repeat_within(self, peer: Peer, watchdog_s: float) -> None:
        """Repeat no command to this drive that it was last sent, or last sent again, longer ago than this."""
        self._partner(peer).watchdog_s = watchdog_s

    def run(
        self,
        peer: Peer,
        exchange: Exchange[T],
        now: float,
        *,
        deadline: float = float("inf"),
        command: CommandCall | None = None,
    ) -> Steps[T]:
        """Carry out an exchange with a drive and return its result. Raises what the exchange raises.

        A drive that has been given up is probed when it is time for that, and refused with NotAnsweringError until
        then; one that was away is set up first. now: the time at which it begins. deadline: when the call's time is
        over. command: raises CommandCancelledError in place of sending what a stop has cancelled.

        An exchange that is cut off in the middle (by closing this generator) leaves the line unclean: the next one
        begins with draining it.
        """
        call = self._call(peer, now, deadline, True, command)
        health = call.partner.health
        if peer.probe is not None and health.given_up:
            yield from self._probe(call, peer.probe)
        try:
            if health.away and peer.set_up is not None:
                yield from carry_out(call, peer.set_up())
                health.away = False
            return (yield from carry_out(call, exchange))
        except NoReplyError:
            self._fell_silent(call, now)
            raise

    def insist(
        self, peer: Peer, exchange: Exchange[T], now: float, *, deadline: float = float("inf"), gives_way: bool = True
    ) -> Steps[T]:
        """Carry out an exchange whatever is known of the drive: for asking whether it is there."""
        call = self._call(peer, now, deadline, gives_way)
        try:
            return (yield from carry_out(call, exchange))
        except NoReplyError:
            self._fell_silent(call, now)
            raise

    def stop(self, peer: Peer, exchange: Exchange[T], now: float, *, deadline: float = float("inf")) -> Steps[T]:
        """Carry out an exchange that stops a motor, whatever is known of the drive; it gives way to nothing."""
        return self.insist(peer, exchange, now, deadline=deadline, gives_way=False)

    def _call(
        self, peer: Peer, now: float, deadline: float, gives_way: bool, command: CommandCall | None = None
    ) -> Call:
        self._line.now = now
        if peer.cautious is not None and not self._line.tuning.holds():
            peer = peer.cautious
        return Call(self._line, peer, self._partner(peer), self.paced, self.stop_waits, deadline, gives_way, command)

    def _fell_silent(self, call: Call, began: float) -> None:
        line, peer = self._line, call.peer
        if call.partner.health.fell_silent(began, line.now, self._probing_time().least_pause_s(self._probe_took_s)):
            line.note(peer, "note", detail="does not answer; it is asked again now and then")
            line.away(peer.name)

    def _probing_time(self) -> ProbingTime:
        return ProbingTime(each.health for each in self._partners.copy().values())

    def _probe(self, call: Call, probe: Callable[[], Exchange[None]]) -> Steps[None]:
        """Ask a drive that has been given up, or refuse until it is time for that."""
        line, peer, partner = self._line, call.peer, call.partner
        health, began = partner.health, line.now
        silent = f"{peer.name} has not answered for {began - health.silent_since:.1f} s"
        if began < health.probe_at:
            raise NotAnsweringError(f"{silent}; it is asked again in {health.probe_at - began:.1f} s")
        time = self._probing_time()
        if not health.patient:
            call.listen_until = began + time.each_s
        health.patient = False
        partner.count["probes"] += 1
        try:
            yield from carry_out(call, probe())
        except ReplyError as error:
            something_came = health.patient
            self._probe_took_s = line.now - began
            health.fell_silent(began, line.now, time.least_pause_s(self._probe_took_s))
            if something_came:
                health.heard_late()
            elif call.listen_until is not None:
                line.probed = partner
            if not isinstance(error, NoReplyError):
                raise
            raise NotAnsweringError(f"{silent}; it was asked again just now") from error
        finally:
            call.listen_until = None

    def _partner(self, peer: Peer) -> PeerState:
        partner = self._partners.get(peer.name)
        if partner is None:
            partner = self._partners.setdefault(peer.name, PeerState(peer.facts.settings))
        elif partner.settings is not peer.facts.settings and partner.settings != peer.facts.settings:
            # Silence at other line settings says nothing about these.
            away, partner.settings, partner.health = partner.health.away, peer.facts.settings, Health()
            partner.health.away = away
        return partner


def _never() -> bool:
    return False
