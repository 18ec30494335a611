"""How far a whole number may go from where it is known to be right: asked of whoever accepts it, not guessed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

FARTHEST = 1 << 33
"""No field of a drive telegram has more than 32 bits."""


def limits(start: int, accepts: Callable[[int], bool]) -> tuple[int, int]:
    """Return the lowest and the highest number that is accepted, as far as all between them are.

    start: a number that is accepted.
    """
    return start - _reach(lambda distance: accepts(start - distance)), start + _reach(
        lambda distance: accepts(start + distance)
    )


def _reach(accepts: Callable[[int], bool]) -> int:
    sound, step = 0, 1
    while step < FARTHEST and accepts(step):
        sound, step = step, step * 2
    refused = step
    while refused - sound > 1:
        middle = (sound + refused) // 2
        if accepts(middle):
            sound = middle
        else:
            refused = middle
    return sound
