"""Forecast of the duration of a scan that gets no answer, before the scan begins.

The steps of the link run against a silent line with a simulated clock, once for each protocol and setting. The forecast
therefore includes all pauses between requests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus import LineDrives, Search, probe
from drivecomm.errors import ReplyError
from drivecomm.link import Arrival, Configure, Link, Send, split_transactions
from drivecomm.protocol import Ask, line_overrides

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.bus import DriveParts, LineChoices, ScanProbe
    from drivecomm.link import LinkSteps
    from drivecomm.protocol import LineSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanForecast:
    """Number of requests of a scan, and its duration in seconds if no drive answers.

    A drive that answers adds the time to read its identity, and saves all further requests to its address.
    """

    questions: int
    settings: int
    seconds: float


def forecast_scan(
    only: Iterable[str] | None = None,
    addresses: Iterable[int] | None = None,
    choices: LineChoices | None = None,
    *,
    guard_s: float = 0.005,
    **facts: Any,
) -> ScanForecast:
    """Return the duration of a scan that gets no answer; opens no port. The arguments are those of `Bus.scan`.

    guard_s: quiet time after a change of line settings, as in `open_bus`. facts: line facts of all drives in the scan.
    """
    roster, given = LineDrives(guard_s=guard_s), line_overrides(facts)
    seconds, questions = 0.0, 0
    known: dict[str, tuple[LineSettings, float]] = {}
    late: dict[str, float] = {}
    before: LineSettings | None = None
    for asking in Search(only, addresses, choices):
        key = str(asking)
        if key not in known:
            member = roster.member(asking.protocol, asking.address, None, None, {**asking.options, **given})
            known[key] = (member.peer.facts.settings, _silence_s(member, asking, guard_s))
        settings, silence_s = known[key]
        seconds += silence_s + (guard_s if before not in (None, settings) else 0.0)
        if asking.protocol in late:
            seconds += late[asking.protocol]
        else:
            member = roster.member(asking.protocol, asking.address, None, None, {**asking.options, **given})
            late[asking.protocol] = _late_s(member, asking)
        questions += 1
        before = settings
    return ScanForecast(questions=questions, settings=len({each for each, _ in known.values()}), seconds=seconds)


def _late_s(member: DriveParts, asking: ScanProbe) -> float:
    """Return how many seconds the next drive of a protocol waits for a late reply that would not name its drive."""
    facts = member.peer.facts
    command = next(probe(asking, member.operations, facts.settings))
    return facts.timing.late_s if isinstance(command, Ask) and command.anonymous else 0.0


def _silence_s(member: DriveParts, asking: ScanProbe, guard_s: float) -> float:
    """Return how many seconds an unanswered request takes that follows another unanswered request."""
    link = Link(guard_s=guard_s)
    link.paced = True
    ends = []
    now = 0.0
    for _ in range(2):
        exchange = probe(asking, member.operations, member.peer.facts.settings)
        now = _unanswered(split_transactions(link.insist(member.peer, exchange, now), now), now)
        ends.append(now)
    return ends[1] - ends[0]


def _unanswered(steps: LinkSteps[Any], now: float) -> float:
    """Run link steps against a silent line, and return the time at which they end."""
    try:
        effect = next(steps)
        while True:
            if not isinstance(effect, Configure | Send):
                now = max(now, effect.until)
            effect = steps.send(Arrival(now))
    except (StopIteration, ReplyError):
        return now
