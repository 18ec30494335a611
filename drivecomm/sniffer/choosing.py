"""Which of several readings that share bytes are the true ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivecomm.sniffer.readings import Reading

# A reading of random bytes is rare, two of them at once are rarer by far: number goes before everything else.
_EACH = 8
# A select of VABus holds the reply with the same value: who explains all bytes is right.
_LEFT_OVER, _MOST_LEFT_OVER = 3, 6
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


def choose(candidates: Sequence[Candidate]) -> list[Candidate] | None:
    """Return those that explain the bytes best and share none, in their order; None when two choices are as good."""
    size = max(each.end for each in candidates) - min(each.start for each in candidates)
    choices = _choices(sorted(candidates, key=lambda each: each.start))
    ranked = sorted(((_weight(choice, size), choice) for choice in choices), key=lambda each: each[0], reverse=True)
    (weight, best), *others = ranked
    return None if others and weight - others[0][0] < _CLEARLY_BETTER else best


def _weight(chosen: list[Candidate], size: int) -> int:
    left_over = size - sum(each.end - each.start for each in chosen)
    return sum(_EACH + each.merit for each in chosen) - min(_MOST_LEFT_OVER, _LEFT_OVER * left_over)


def _choices(candidates: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    """Yield each choice to which none can be added."""
    if not candidates:
        yield []
        return
    # One of those that begin before the first of them is over is in every complete choice.
    soonest = min(each.end for each in candidates)
    for first in candidates:
        if first.start >= soonest:
            break
        for rest in _choices([each for each in candidates if each.start >= first.end]):
            yield [first, *rest]
