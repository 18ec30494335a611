"""Profiles without states, made from tables of steps: each command of the drive has a place of its own.

A command is a list of steps, each `[address, value]` or `[address, value, mask]`. The master writes the value; a
virtual drive looks only at the bits of the mask. A condition of `status` is `[address, mask, value]`, where the value
may be a list: it holds when the masked word is one of the values.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.profiles.profile import Condition, ControlProfile, Refusal, State, Step
from drivecomm.protocol import DriveState, Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_STOPS = {"stop": Stop.RAMP, "coast": Stop.COAST, "quick": Stop.QUICK, "dc_brake": Stop.DC_BRAKE}
ORDERS = ("start", "start_reverse", *_STOPS, "reset")
"""Commands that a table may have; `stop` is a stop down the ramp."""

ONLY_SHOWN = ("reverse_ordered", "always")
"""Status entries for virtual drives only.

reverse_ordered: the ordered direction, which the motor may not have yet. always: bits that are set at all times.
"""

SAID = (
    "running", "started", "fault", "ready", "stopping", "warning", "at_reference", "reverse", "remote", *ONLY_SHOWN,
)  # fmt: skip
"""Entries of a status. started: the drive obeys a start, if a turning motor alone does not prove that."""

TRIPPED = "tripped"
"""Place that shows whether a drive has a fault, as found from its status or from the code of the fault."""

_IS_TRIPPED = Condition(place=TRIPPED, mask=1, values=(1,))
_IS_HEALTHY = Condition(place=TRIPPED, mask=1, values=(0,))
_ANYHOW = Condition(place=TRIPPED, mask=0, values=(0,))


def steps_of(name: str, given: Any, place_of: Callable[[str], tuple[str, int]]) -> tuple[Step, ...]:
    """Return the steps of one entry. Raises UsageError for an invalid one.

    place_of: returns the place of an address, and its lowest bit in the word.
    """
    steps = []
    for each in given:
        if (
            not isinstance(each, tuple | list)
            or len(each) not in (2, 3)
            or any(type(one) is not int for one in each[1:])
        ):
            raise UsageError(f"[control] {name}: a step is [address, value] or [address, value, mask], not {each!r}")
        steps.append(Step(place=place_of(each[0])[0], word=each[1], mask=each[2] if len(each) == 3 else 0xFFFF))
    return tuple(steps)


def status_of(given: Mapping[str, Any], place_of: Callable[[str], tuple[str, int]]) -> dict[str, Condition]:
    """Return the conditions of a table `status`. Raises UsageError for an unknown or invalid entry."""
    if strange := sorted(set(given) - set(SAID)):
        raise UsageError(f"[control] status: unknown key {strange[0]!r}; it has {', '.join(SAID)}")
    return {name: condition_of(f"status, {name}", each, place_of) for name, each in given.items()}


def condition_of(name: str, given: Any, place_of: Callable[[str], tuple[str, int]]) -> Condition:
    """Return the condition of one entry. Raises UsageError for an invalid one.

    place_of: as in `steps_of`.
    """
    if not isinstance(given, tuple | list) or len(given) != 3 or type(given[1]) is not int:
        raise UsageError(f"[control] {name}: a condition is [address, mask, value], not {given!r}")
    values = given[2] if isinstance(given[2], tuple | list) else (given[2],)
    place, shift = place_of(given[0])
    return Condition(place=place, mask=given[1] << shift, values=tuple(each << shift for each in values))


def profile_of_orders(
    name: str,
    orders: Mapping[str, tuple[Step, ...]],
    status: Mapping[str, Condition],
    pause_s: float = 0.0,
    way: Condition | None = None,
) -> ControlProfile:
    """Return the profile of these commands and this status.

    pause_s: between the steps of a start. way: the values of the status before the first step of a start and after
    each. Each value is awaited; the steps to a value that the drive already shows are left out.
    """
    states = {
        "fault": (_IS_TRIPPED, DriveState.FAULT),
        "stopping": (status.get("stopping"), DriveState.STOPPING),
        "running": (status.get("running"), DriveState.RUNNING),
        "ready": (status.get("ready", _ANYHOW), DriveState.READY),
    }
    obeyed = tuple(status[each] for each in ("started", "running") if each in status)[:1]

    def start(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        spaced = (*steps[:1], *(replace(step, pause_s=pause_s) for step in steps[1:]))
        if way is not None:
            reached = [(replace(way, values=way.values[number:]),) for number in range(1, len(steps))]
            before = (replace(step, unless=by, until=by) for step, by in zip(spaced[:-1], reached, strict=True))
            spaced = (*before, *spaced[-1:])
        return (*spaced[:-1], *(replace(step, until=obeyed) for step in spaced[-1:]))

    refusal = Refusal(when=(_IS_TRIPPED,), say="the drive has a fault{code} and cannot start; reset it first")
    return ControlProfile(
        name=name,
        start=start(orders.get("start", ())),
        start_reverse=start(orders.get("start_reverse", ())),
        stops={how: orders[key] for key, how in _STOPS.items() if key in orders},
        reset=_reset_of(orders.get("reset", ()), until=(_IS_HEALTHY,) if status else ()),
        refusals=(refusal,) if status else (),
        states=tuple(State(name=each, known_by=by, means=means) for each, (by, means) in states.items() if by),
        bits={**{each: (by,) for each, by in status.items() if each not in ONLY_SHOWN}, "fault": (_IS_TRIPPED,)},
    )


def _reset_of(steps: tuple[Step, ...], until: tuple[Condition, ...]) -> tuple[Step, ...]:
    """Return the steps that acknowledge a fault: an edge even if its bit is still set, until the fault is gone."""
    if not steps:
        return ()
    *before, last = steps
    taken_back = [step for step in before if step.place == last.place and step.word != last.word]
    return (*([last] if taken_back else []), *before, replace(last, until=until))
