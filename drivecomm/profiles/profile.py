"""What a control profile is made of: control words and their order, and what status words say.

A drive has one control word and one status word, or several registers and coils for both; a place says which is meant,
in the words of the protocol. Where there is only one, it has no name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any, Literal, TypeAlias

from drivecomm.errors import ValueRefusedError
from drivecomm.protocol import DriveState, DriveStatus, Stop

Words: TypeAlias = Mapping[str, int]
"""What was read from a drive, by place."""

ONLY = ""
"""The place of the control word, or the status word, of a drive that has one of it."""

MotorDoes: TypeAlias = Literal["off", "run", "ramp", "quick", "dc_brake", "hold"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Whether bits of a word are so: under the mask it is one of the values."""

    mask: int
    values: tuple[int, ...]
    place: str = ONLY

    def holds(self, words: Words) -> bool:
        """Whether it is so; what was not read is not."""
        word = words.get(self.place)
        return word is not None and word & self.mask in self.values


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One control word on a way.

    unless: it is left out where one of these holds before. until: what is awaited after it, one of these. repeats:
    whether it may be sent again when no reply came; a word that starts a motor, or that has an edge, may not. mask: the
    bits that a drive looks at. pause_s: passes before it.
    """

    word: int
    place: str = ONLY
    mask: int = 0xFFFF
    unless: tuple[Condition, ...] = ()
    until: tuple[Condition, ...] = ()
    repeats: bool = False
    pause_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """When a motor is not to be started, and why, in a sentence."""

    when: tuple[Condition, ...]
    say: str


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """A state: by what bits of the status word it is known, and what the drive does with its motor in it.

    shows: the bits of the status word that a drive shows in it. stands: the state that it comes to when the motor
    stands.
    """

    name: str
    known_by: Condition
    means: DriveState
    shows: int = 0
    motor: MotorDoes = "off"
    stands: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """What brings a drive from one of some states into another: bits of the control word, or one that rises."""

    origins: frozenset[str]
    mask: int
    value: int
    rising: int
    goal: str

    def leads_on(self, state: str, word: int, before: int) -> bool:
        """Whether a control word brings a drive on from a state. before: the control word that came before."""
        return (
            state in self.origins
            and word & self.mask == self.value
            and (not self.rising or bool(word & ~before & self.rising))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlProfile:
    """How drives are commanded.

    valid: bits without which a control word commands nothing, 0 where every one commands. idle: a word that commands
    nothing, None where there is none. off: bits that stop by being 0 even in a word without the valid bits. reverse:
    bits that turn the motor backwards, 0 where the sign of the reference does, or `start_reverse`. full: what 100 % is
    in reference and actual value. runs: what is so of each control word that lets a motor run. follows: what is so of
    each control word with which a running motor follows its reference, None where all do; with others it runs at 0.
    named_states: whether the manuals name the states, so that a status shows them by name. bits: when it is that a
    `DriveStatus` says so. flags: names of bits of the status word.
    """

    name: str
    title: str = ""
    source: str = ""
    valid: int = 0
    idle: int | None = None
    off: int = 0
    reverse: int = 0
    full: int = 0
    runs: Condition | None = None
    follows: Condition | None = None
    start: tuple[Step, ...] = ()
    start_reverse: tuple[Step, ...] = ()
    stops: Mapping[Stop, tuple[Step, ...]] = field(default_factory=dict)
    reset: tuple[Step, ...] = ()
    refusals: tuple[Refusal, ...] = ()
    states: tuple[State, ...] = ()
    named_states: bool = False
    bits: Mapping[str, tuple[Condition, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)
    transitions: tuple[Transition, ...] = ()

    @property
    def take_back(self) -> tuple[Step, ...]:
        """What a start is taken back by that was not obeyed: the gentlest stop."""
        return next((self.stops[how] for how in Stop if how in self.stops), ())

    def start_towards(self, *, reverse: bool) -> tuple[Step, ...]:
        """Return how the motor is started in a direction: only what lets it run tells which."""
        if not reverse:
            return self.start
        turned = (replace(step, word=step.word | self.reverse * self.lets_run(step.word)) for step in self.start)
        return self.start_reverse or tuple(turned)

    def state(self, name: str) -> State:
        """Return the state with a name."""
        return next(state for state in self.states if state.name == name)

    def next_state(self, state: State, word: int, before: int) -> State:
        """Return the state that a control word leads to, over as many others as it leads through.

        before: the control word that came before.
        """
        for _ in self.states:
            found = next((each for each in self.transitions if each.leads_on(state.name, word, before)), None)
            if found is None:
                break
            # An edge leads on once.
            state, before = self.state(found.goal), word
        return state

    def asks(self, word: int) -> MotorDoes:
        """Return what a control word asks of a motor that runs; what only an edge does, it does not ask."""
        running = next(state for state in self.states if state.motor == "run")
        return self.next_state(running, word, word).motor

    def state_of(self, words: Words) -> State | None:
        """Return the state that status words mean, None for one that no manual lists."""
        return next((state for state in self.states if state.known_by.holds(words)), None)

    def says(self, bit: str, words: Words) -> bool | None:
        """Return whether status words say so; None where they say nothing about it."""
        given = self.bits.get(bit)
        return None if given is None else any(each.holds(words) for each in given)

    def flags_of(self, word: int) -> tuple[str, ...]:
        """Return the names of the bits that are set in a status word."""
        return tuple(name for bit, name in self.flags.items() if word >> bit & 1)

    def _said(self, words: Words) -> tuple[str, ...]:
        return tuple(bit for bit in self.bits if self.says(bit, words))

    def word_of(self, says: Mapping[str, bool]) -> int:
        """Return the status word whose bits with these names are so; the others are 0."""
        return sum(1 << bit for bit, name in self.flags.items() if says.get(name))

    def steps_of(self, percent: Decimal) -> int:
        """Return the reference of 16 bits that is nearest to a percentage; halves go to the even step.

        Raises ValueRefusedError for one that 16 bits do not hold.
        """
        # What is far beyond has too many digits to be rounded.
        if abs(percent) < 1000:
            steps = (percent * self.full / 100).quantize(Decimal(1), ROUND_HALF_EVEN)
            if -(2**15) <= steps < 2**15:
                return int(steps)
        least, most = -self.percent_of(2**15), self.percent_of(2**15 - 1)
        raise ValueRefusedError(
            f"a reference of {percent} % is beyond what the telegram holds, {least:.5g} % to {most:.5g} %"
        )

    def percent_of(self, steps: int) -> Decimal:
        """Return what share of 100 % a reference or an actual value is."""
        return Decimal(100) * steps / self.full

    def commands(self, word: int) -> bool:
        """Whether a drive obeys a control word at all."""
        return word & self.valid == self.valid

    def directed(self, word: int, reference: float) -> float:
        """Return what a drive makes of a signed reference by a control word: its direction, or 0."""
        if self.follows is not None and not self.follows.holds({ONLY: word}):
            return 0.0
        return -reference if word & self.reverse else reference

    def may_start(self, word: int) -> bool:
        """Whether a control word may start a motor: it commands, and it is none that stops or resets."""
        harmless = {step.word for steps in (*self.stops.values(), self.reset) for step in steps}
        return self.commands(word) and word not in harmless

    def lets_run(self, word: int) -> bool:
        """Whether a control word lets a motor run."""
        return self.runs is not None and self.runs.holds({ONLY: word})

    def status(self, words: Words, **further: Any) -> DriveStatus:
        """Return what status words say. further: what else a `DriveStatus` tells, from elsewhere."""
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
