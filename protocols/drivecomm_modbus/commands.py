"""Commands as a drive hears them: which one is complete with what was just written.

The steps of a command that go to one register must come in their order (0006, 0007, 000F); those to other registers
must hold at that time (direction, then run). A command is complete with the write that completes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from drivecomm_modbus.control import Control, Step

_IN_ORDER = ("reset", "coast", "quick", "dc_brake", "stop", "start_reverse", "start")
"""Stops before starts: what could be both is a stop first."""


class Commands:
    """How far each command of a drive has come."""

    def __init__(self, control: Control) -> None:
        self._steps: dict[str, dict[tuple[str, int], list[Step]]] = {}
        for name in _IN_ORDER:
            for step in control.steps.get(name, ()):
                own = self._steps.setdefault(name, {})
                own.setdefault((step.place.kind, step.place.start), []).append(step)
        self._done: dict[tuple[str, tuple[str, int]], int] = {}

    def power_up(self, words: Mapping[tuple[str, int], int]) -> None:
        """Begin anew; what a register holds after mains counts only where it is one step of one."""
        for name, registers in self._steps.items():
            for spot, steps in registers.items():
                self._done[name, spot] = int(len(steps) == 1 and steps[0].holds(words[spot]))

    def heard(self, spots: Collection[tuple[str, int]], words: Mapping[tuple[str, int], int]) -> Iterator[str]:
        """Yield the commands that are complete now that these registers have been written, stops before starts."""
        for name, registers in self._steps.items():
            touched = [spot for spot in registers if spot in spots]
            for spot in touched:
                self._done[name, spot] = _progress(registers[spot], self._done[name, spot], words[spot])
            if touched and all(self._done[name, spot] == len(steps) for spot, steps in registers.items()):
                yield name


def _progress(steps: list[Step], done: int, value: int) -> int:
    """Return how many steps to one register are done after this value."""
    if done < len(steps) and steps[done].holds(value):
        return done + 1
    return next((number for number in range(done, 0, -1) if steps[number - 1].holds(value)), 0)
