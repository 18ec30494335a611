"""Profiles without states from tables of steps: a place of its own for each thing that a drive can be told.

A command is a list of steps, each `[address, value]` or `[address, value, mask]`: the master writes the value; a
virtual drive looks at the bits of the mask only. A condition of `status` is `[address, mask, value]`, or a list of
values: it holds when the word, masked, is one of them.
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
"""Commands that a table may have; a stop without a further word is down the ramp."""

ONLY_SHOWN = ("reverse_ordered", "always")
"""What only a virtual drive shows: the direction that was ordered, which the motor may not have yet, and bits that are
set at all times."""

SAID = (
    "running", "started", "fault", "ready", "stopping", "warning", "at_reference", "reverse", "remote", *ONLY_SHOWN,
)  # fmt: skip
"""What a status may say. started: that a start is obeyed, where that is more than that the motor turns."""

TRIPPED = "tripped"
"""The place where whoever looks at a drive notes whether it has a fault, by its status or by the code of the fault."""

_IS_TRIPPED = Condition(place=TRIPPED, mask=1, values=(1,))
_IS_HEALTHY = Condition(place=TRIPPED, mask=1, values=(0,))
_ANYHOW = Condition(place=TRIPPED, mask=0, values=(0,))


def steps_of(name: str, given: Any, place_of: Callable[[str], tuple[str, int]]) -> tuple[Step, ...]:
    """Return the steps of one entry. place_of: of an address, and how far up in its word it begins."""
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
    """Return the conditions of a table `status`. Raises UsageError."""
    if strange := sorted(set(given) - set(SAID)):
        raise UsageError(f"[control] status: unknown key {strange[0]!r}; it has {', '.join(SAID)}")
    return {name: condition_of(f"status, {name}", each, place_of) for name, each in given.items()}


def condition_of(name: str, given: Any, place_of: Callable[[str], tuple[str, int]]) -> Condition:
    """Return the condition of one entry. place_of: as of `steps_of`. Raises UsageError."""
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

    pause_s: between the steps of a start. way: what the status shows before the first step of a start and after each;
    each is awaited, and a drive that shows it already is not sent what leads there.
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
    """Return how a fault is acknowledged: by an edge also where its bit was left set, and until the fault is gone."""
    if not steps:
        return ()
    *before, last = steps
    taken_back = [step for step in before if step.place == last.place and step.word != last.word]
    return (*([last] if taken_back else []), *before, replace(last, until=until))
