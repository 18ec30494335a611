"""Which of several readings that share bytes are the true ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.traffic.sniffer.readings import Reading

# A reading of random bytes is rare, two of them at once are rarer by far: number goes before everything else.
_EACH = 8
# A select of VABus holds the reply with the same value: who explains all bytes is right.
_LEFT_OVER, _MANY = 3, 2
_CLEARLY_BETTER = 2


@dataclass(frozen=True, slots=True)
class Candidate:
    """One telegram that may have been sent, one way or the other. merit: what else speaks for it, or against."""

    readings: tuple[Reading, ...]
    merit: int

    @property
    def start(self) -> int:
        """Where it begins."""
        return self.readings[0].start

    @property
    def end(self) -> int:
        """Where it is over."""
        return self.readings[0].end


@dataclass(frozen=True, slots=True)
class _Choice:
    """Candidates one behind the other. end: where the last is over; left_over: characters before it that none has."""

    weight: int
    end: int
    left_over: int
    chosen: tuple[Candidate, ...] = ()

    def behind(self, next_one: Candidate) -> _Choice:
        left_over = min(_MANY, self.left_over + next_one.start - self.end)
        return _Choice(self.weight + _EACH + next_one.merit, next_one.end, left_over, (*self.chosen, next_one))

    def complete(self, end: int) -> int:
        """Return the weight when nothing follows."""
        return self.weight - _LEFT_OVER * min(_MANY, self.left_over + end - self.end)


def choose(candidates: Sequence[Candidate]) -> list[Candidate] | None:
    """Return those that explain the bytes best and share none, in their order; None when two choices are as good."""
    begin, end = min(each.start for each in candidates), max(each.end for each in candidates)
    choices = [_Choice(weight=0, end=begin, left_over=0)]
    for each in sorted(candidates, key=lambda each: each.end):
        longer = [choice.behind(each) for choice in choices if choice.end <= each.start]
        # What is not among the two best here is not among the two best in the end.
        for left_over in range(_MANY + 1):
            choices += _best(choice for choice in longer if choice.left_over == left_over)
    ranked = sorted(choices, key=lambda choice: choice.complete(end), reverse=True)[:2]
    best, second = ranked
    return None if best.complete(end) - second.complete(end) < _CLEARLY_BETTER else list(best.chosen)


def _best(choices: Iterable[_Choice]) -> list[_Choice]:
    return sorted(choices, key=lambda choice: choice.weight, reverse=True)[:2]
