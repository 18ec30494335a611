"""Mistakes in a control profile: words that no drive could obey, and words that would not be safe."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.profiles.profile import SOLE_PLACE
from drivecomm.protocol import DriveState

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.profiles.profile import ControlProfile


def mistakes_in(profile: ControlProfile) -> Iterator[str]:
    """Yield the mistakes in a profile, one sentence each."""
    yield from _starts_and_stops(profile)
    yield from _states(profile)
    if profile.transitions:
        yield from _transitions(profile)


def _starts_and_stops(profile: ControlProfile) -> Iterator[str]:
    stopping = {(step.place, step.word) for steps in profile.stops.values() for step in steps}
    if not profile.stops:
        yield "it defines how to start a motor, but not how to stop it" if profile.start else "it stops no motor"
    for how, steps in profile.stops.items():
        if any(not step.repeats for step in steps):
            yield f"a stop by {how.value} that no reply came to would not be sent again; write repeats = true"
        if any(profile.lets_run(step.word) for step in steps if step.place == SOLE_PLACE):
            yield f"a stop by {how.value} lets the motor run"
    for steps, name in ((profile.start, "start"), (profile.start_reverse, "start_reverse")):
        acting = [step for step in steps if (step.place, step.word) not in stopping and _may_act(profile, step.word)]
        if any(step.repeats for step in acting):
            yield f"a word of {name} that may start a motor would be sent again; leave repeats out"
        if steps and (steps[-1].place, steps[-1].word) in stopping:
            yield f"the last word of {name} stops the motor"
    if any(profile.lets_run(step.word) for step in profile.reset if step.place == SOLE_PLACE):
        yield "the reset has a word that lets the motor run"
    if profile.idle is not None and profile.commands(profile.idle) and profile.lets_run(profile.idle):
        yield "the idle word lets a motor run"


def _may_act(profile: ControlProfile, word: int) -> bool:
    return profile.lets_run(word) or profile.runs is None


def _states(profile: ControlProfile) -> Iterator[str]:
    for state in profile.states:
        if not any(value & state.known_by.mask == value for value in state.known_by.values):
            yield f"no status word is the state {state.name!r}: its value has bits that its mask leaves out"
        shown = {state.known_by.place: state.shows}
        known = profile.state_of(shown)
        if known is None or known.means is not state.means:
            yield f"the state {state.name!r} is shown as {known.name if known else 'none'!r}"


def _transitions(profile: ControlProfile) -> Iterator[str]:
    reached, waiting = set(), [profile.states[0].name]
    ways = [(each.origins, each.goal) for each in profile.transitions]
    ways += [(frozenset([state.name]), state.stands) for state in profile.states if state.stands]
    # A drive can trip in any state.
    tripped = [state.name for state in profile.states if state.means is DriveState.FAULT]
    waiting += tripped[-1:]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += [goal for origins, goal in ways if name in origins]
    if not any(state.name in reached for state in profile.states if state.motor == "run"):
        yield "no step leads to a state in which the motor runs"
    if tripped and not any(name in origins for origins, _ in ways for name in tripped[-1:]):
        yield "no step leads out of a fault"
    for each in profile.transitions:
        if not each.rising and any(name in tripped for name in each.origins):
            yield f"a fault is left without an edge, for {each.goal!r}"
