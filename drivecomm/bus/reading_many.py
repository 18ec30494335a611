"""Reading of many parameters with as few telegrams as the protocol allows; one by one if it has no blocks.

A drive refuses a block as a whole, and does not say which of its parameters it refuses. The block is then read in two
halves, and each refused half in halves again, so that in the end only the parameters that the drive does not have are
refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import RefusedError, UsageError, shortened
from drivecomm.protocol import ReadsMany

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.bus.exchanges import Exchanges
    from drivecomm.errors import DriveCommError
    from drivecomm.protocol import Exchange, Reading

ReadingOrError: TypeAlias = "Reading | DriveCommError"

_MOST = 1000
"""Maximum number of parameters in one call: more than a program needs at a time, but readable within a call's time."""


class ManyReads:
    """Exchanges that read many parameters. time: returns the time of a reply that has just arrived."""

    def __init__(self, exchanges: Exchanges, time: Callable[[], float]) -> None:
        self._exchanges = exchanges
        self._time = time

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return groups of parameters that one telegram reads, as indexes; an unreadable parameter is alone."""
        operations = self._exchanges.operations
        if not isinstance(operations, ReadsMany):
            return [[place] for place in range(len(parameters))]
        good, alone = [], []
        for place, parameter in enumerate(parameters):
            try:
                self._exchanges.to_read(parameter, {}).close()
            except UsageError:
                alone.append([place])
            else:
                good.append(place)
        found = operations.blocks([self._exchanges.address_of(parameters[place]) for place in good])
        return [*([good[place] for place in block] for block in found), *alone]

    def to_read_block(self, parameters: Sequence[str]) -> Exchange[list[Reading]]:
        """Read the parameters of one of the `blocks`; a refusal applies to all of them."""
        operations = self._exchanges.operations
        if len(parameters) == 1 or not isinstance(operations, ReadsMany):
            readings = []
            for parameter in parameters:
                reading = yield from self._exchanges.to_read(parameter, {})
                readings.append(reading.at(self._time()))
            return readings
        found = yield from operations.read_many([self._exchanges.address_of(each) for each in parameters])
        now = self._time()
        return [
            self._exchanges.converted_reading(parameter, reading).at(now)
            for parameter, reading in zip(parameters, found, strict=True)
        ]

    def to_read_many(self, parameters: Sequence[str]) -> Exchange[list[ReadingOrError]]:
        """Read parameters; the result of a refused one is its error. Raises UsageError before anything is sent."""
        if not isinstance(parameters, list | tuple):
            raise UsageError(f"{shortened(parameters)} is not a list of parameters; use read for a single one")
        if len(parameters) > _MOST:
            raise UsageError(f"{len(parameters)} parameters are too many for one call; give at most {_MOST}")
        for parameter in parameters:
            self._exchanges.check_read(parameter, {})
        return self._read_many(parameters)

    def _read_many(self, parameters: Sequence[str]) -> Exchange[list[ReadingOrError]]:
        came: dict[int, ReadingOrError] = {}
        waiting = self.blocks(parameters)[::-1]
        while waiting:
            block = waiting.pop()
            try:
                readings = yield from self.to_read_block([parameters[place] for place in block])
            except RefusedError as error:
                if len(block) == 1:
                    came[block[0]] = error
                else:
                    half = len(block) // 2
                    waiting += [block[half:], block[:half]]
            else:
                came.update(zip(block, readings, strict=True))
        return [came[place] for place in range(len(parameters))]
