"""How long a scan takes if nobody answers, before it is begun.

The link's own steps are taken against a line on which nothing comes, with a clock that is a number, once for each
protocol and setting. So whatever holds between requests is in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus import Roster, Search, probe
from drivecomm.errors import ReplyError
from drivecomm.link import Arrival, Configure, Link, Send, taken_apart
from drivecomm.protocol import Ask, line_overrides

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.bus import Asking, LineChoices, Member
    from drivecomm.link import Steps
    from drivecomm.protocol import LineSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanForecast:
    """What a scan asks at most, and how many seconds that takes while nobody answers.

    Who answers costs the time in which it tells what it is, and saves all further questions to its address.
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
    """Return how long a scan takes without an answer; opens no port. The arguments are those of `Bus.scan`.

    guard_s: quiet time after a change of line settings, as `open_bus` has it. facts: line facts for all drives asked.
    """
    roster, given = Roster(guard_s=guard_s), line_overrides(facts)
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


def _late_s(member: Member, asking: Asking) -> float:
    """Return how long the next drive of a protocol waits for a late reply that would name no drive."""
    facts = member.peer.facts
    command = next(probe(asking, member.operations, facts.settings))
    return facts.timing.late_s if isinstance(command, Ask) and command.anonymous else 0.0


def _silence_s(member: Member, asking: Asking, guard_s: float) -> float:
    """Return how long one question takes that comes after another one and is not answered."""
    link = Link(guard_s=guard_s)
    link.paced = True
    ends = []
    now = 0.0
    for _ in range(2):
        exchange = probe(asking, member.operations, member.peer.facts.settings)
        now = _unanswered(taken_apart(link.insist(member.peer, exchange, now), now), now)
        ends.append(now)
    return ends[1] - ends[0]


def _unanswered(steps: Steps[Any], now: float) -> float:
    """Take steps on a line on which nothing comes, and return when they are over."""
    try:
        effect = next(steps)
        while True:
            if not isinstance(effect, Configure | Send):
                now = max(now, effect.until)
            effect = steps.send(Arrival(now))
    except (StopIteration, ReplyError):
        return now
