"""Parts of a control profile: control words and their order, and the meaning of status words.

A drive has one control word and one status word, or several registers and coils for both. A place names one of them, in
the words of the protocol; if there is only one, it has no name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any, Literal, TypeAlias

from drivecomm.errors import ValueRefusedError
from drivecomm.protocol import DriveState, DriveStatus, Stop

Words: TypeAlias = Mapping[str, int]
"""Words that were read from a drive, by place."""

SOLE_PLACE = ""
"""The place of the control word, or of the status word, if a drive has only one."""

MotorDoes: TypeAlias = Literal["off", "run", "ramp", "quick", "dc_brake", "hold"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BitCondition:
    """Condition on bits of a word: the masked word is one of the values."""

    mask: int
    values: tuple[int, ...]
    place: str = SOLE_PLACE

    def holds(self, words: Words) -> bool:
        """Return whether the condition holds; False if its word was not read."""
        word = words.get(self.place)
        return word is not None and word & self.mask in self.values


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlStep:
    """One control word in a sequence.

    unless: the step is left out if one of these conditions holds at the start of the sequence. until: after the
    step, one of these conditions is awaited. repeats: whether the word may be sent again if no reply came; not for a
    word that starts a motor or has an edge. mask: the bits that a drive examines. pause_s: pause before the step.
    """

    word: int
    place: str = SOLE_PLACE
    mask: int = 0xFFFF
    unless: tuple[BitCondition, ...] = ()
    until: tuple[BitCondition, ...] = ()
    repeats: bool = False
    pause_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRefusal:
    """Conditions under which a motor must not be started, and the reason as a sentence."""

    when: tuple[BitCondition, ...]
    say: str


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One state of a drive: the bits of the status word that identify it, and the action on the motor in it.

    shows: the bits of the status word that a drive shows in it. stands: the next state after the motor has come to a
    standstill.
    """

    name: str
    known_by: BitCondition
    means: DriveState
    shows: int = 0
    motor: MotorDoes = "off"
    stands: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateTransition:
    """Change from some states into another, caused by bits of the control word or by a rising one."""

    origins: frozenset[str]
    mask: int
    value: int
    rising: int
    goal: str

    def leads_on(self, state: str, word: int, before: int) -> bool:
        """Return whether a control word causes the transition from a state.

        before: the control word that came before.
        """
        return (
            state in self.origins
            and word & self.mask == self.value
            and (not self.rising or bool(word & ~before & self.rising))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlProfile:
    """Profile by which drives are commanded: their control words and status words.

    valid: bits without which a control word commands nothing, 0 if every one commands. idle: a word that commands
    nothing, None if there is none. off: bits that stop by being 0, even in a word without the valid bits. reverse: bits
    that turn the motor backwards, 0 if the sign of the reference or `start_reverse` does. full: the number for 100 % in
    reference and actual value. runs: condition of each control word that lets a motor run. follows: condition of each
    control word with which a running motor follows its reference, None if all do; with others it runs at 0.
    named_states: whether the manuals name the states, so that a status shows them by name. bits: the conditions for
    each statement of a `DriveStatus`. flags: names of bits of the status word.
    """

    name: str
    title: str = ""
    source: str = ""
    valid: int = 0
    idle: int | None = None
    off: int = 0
    reverse: int = 0
    full: int = 0
    runs: BitCondition | None = None
    follows: BitCondition | None = None
    start: tuple[ControlStep, ...] = ()
    start_reverse: tuple[ControlStep, ...] = ()
    stops: Mapping[Stop, tuple[ControlStep, ...]] = field(default_factory=dict)
    reset: tuple[ControlStep, ...] = ()
    refusals: tuple[StartRefusal, ...] = ()
    states: tuple[State, ...] = ()
    named_states: bool = False
    bits: Mapping[str, tuple[BitCondition, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)
    transitions: tuple[StateTransition, ...] = ()

    @property
    def take_back(self) -> tuple[ControlStep, ...]:
        """Steps that take back a start which the drive did not obey: the gentlest stop."""
        return next((self.stops[how] for how in Stop if how in self.stops), ())

    def start_towards(self, *, reverse: bool) -> tuple[ControlStep, ...]:
        """Return the steps of a start in a direction; only the words that let the motor run carry the direction."""
        if not reverse:
            return self.start
        turned = (replace(step, word=step.word | self.reverse * self.lets_run(step.word)) for step in self.start)
        return self.start_reverse or tuple(turned)

    def state(self, name: str) -> State:
        """Return the state with this name."""
        return next(state for state in self.states if state.name == name)

    def next_state(self, state: State, word: int, before: int) -> State:
        """Return the state to which a control word leads, through any number of others.

        before: the control word that came before.
        """
        for _ in self.states:
            found = next((each for each in self.transitions if each.leads_on(state.name, word, before)), None)
            if found is None:
                break
            # An edge causes one transition only.
            state, before = self.state(found.goal), word
        return state

    def asks(self, word: int) -> MotorDoes:
        """Return the action that a control word demands of a running motor, without the effect of edges."""
        running = next(state for state in self.states if state.motor == "run")
        return self.next_state(running, word, word).motor

    def state_of(self, words: Words) -> State | None:
        """Return the state that status words mean; None if no manual lists it."""
        return next((state for state in self.states if state.known_by.holds(words)), None)

    def says(self, bit: str, words: Words) -> bool | None:
        """Return whether a statement, such as "running", is true in status words; None if they do not show it."""
        given = self.bits.get(bit)
        return None if given is None else any(each.holds(words) for each in given)

    def flags_of(self, word: int) -> tuple[str, ...]:
        """Return the names of the bits that are set in a status word."""
        return tuple(name for bit, name in self.flags.items() if word >> bit & 1)

    def _said(self, words: Words) -> tuple[str, ...]:
        return tuple(bit for bit in self.bits if self.says(bit, words))

    def word_of(self, says: Mapping[str, bool]) -> int:
        """Return the status word with the bits set whose names are true; all others are 0."""
        return sum(1 << bit for bit, name in self.flags.items() if says.get(name))

    def steps_of(self, percent: Decimal) -> int:
        """Return the 16-bit reference that is nearest to a percentage; halves go to the even step.

        Raises ValueRefusedError for one that 16 bits cannot hold.
        """
        # Numbers far beyond the range have too many digits to be rounded.
        if abs(percent) < 1000:
            steps = (percent * self.full / 100).quantize(Decimal(1), ROUND_HALF_EVEN)
            if -(2**15) <= steps < 2**15:
                return int(steps)
        least, most = -self.percent_of(2**15), self.percent_of(2**15 - 1)
        raise ValueRefusedError(
            f"a reference of {percent} % is beyond what the telegram holds, {least:.5g} % to {most:.5g} %"
        )

    def percent_of(self, steps: int) -> Decimal:
        """Return a reference or an actual value in per cent."""
        return Decimal(100) * steps / self.full

    def commands(self, word: int) -> bool:
        """Return whether a drive obeys a control word at all."""
        return word & self.valid == self.valid

    def directed(self, word: int, reference: float) -> float:
        """Return a signed reference with the direction of a control word; 0 if the motor does not follow it."""
        if self.follows is not None and not self.follows.holds({SOLE_PLACE: word}):
            return 0.0
        return -reference if word & self.reverse else reference

    def may_start(self, word: int) -> bool:
        """Return whether a control word may start a motor: it commands, and belongs to no stop or reset."""
        harmless = {step.word for steps in (*self.stops.values(), self.reset) for step in steps}
        return self.commands(word) and word not in harmless

    def lets_run(self, word: int) -> bool:
        """Return whether a control word lets a motor run."""
        return self.runs is not None and self.runs.holds({SOLE_PLACE: word})

    def status(self, words: Words, **further: Any) -> DriveStatus:
        """Return the status that status words mean.

        further: fields of the `DriveStatus` that come from elsewhere.
        """
        state = self.state_of(words)
        means = state.means if state else DriveState.NOT_READY
        running = self.says("running", words)
        fault = self.says("fault", words)
        word = next(iter(words.values()))
        titled = (state.name if state else "unlisted state",) if self.named_states else ()
        said: dict[str, Any] = {
            "running": means in (DriveState.RUNNING, DriveState.STOPPING) if running is None else running,
            "fault": means is DriveState.FAULT if fault is None else fault,
            **{name: self.says(name, words) for name in ("warning", "at_reference", "reverse", "remote")},
            "flags": (*titled, *(self.flags_of(word) if self.flags else self._said(words))),
        }
        return DriveStatus(word=word, state=means, **{**said, **further})
