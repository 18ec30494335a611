"""What a virtual drive holds in its parameters, in RAM and in EEPROM, and which access to them it refuses.

A key names a parameter, a place one of its values: a number and a number with a data set, or an index, say.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from drivecomm.protocol.refusal import Refusal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from decimal import Decimal

    from drivecomm.protocol.model import ParameterInfo

K = TypeVar("K")
P = TypeVar("P")
V = TypeVar("V")


class ParameterStore(Generic[K, P, V]):
    """The parameters of one virtual drive.

    infos: what is known of each, by its key. starts: what each place holds at first. codes: with what code of its
    protocol the drive refuses, by the reason: unknown, not readable, not writable, running, limits. held: what each
    place holds now. measured: what gives the value of a place that shows one; it is asked when the place is read, so
    that nothing set there is ever seen.
    """

    def __init__(self, infos: Mapping[K, ParameterInfo], starts: Mapping[P, V], codes: Mapping[str, int]) -> None:
        self.held = dict(starts)
        self.measured: Mapping[Any, Callable[[], float]] = {}
        self._eeprom = dict(starts)
        self._infos = dict(infos)
        self._codes = codes

    def info(self, key: K) -> ParameterInfo:
        """Return what is known of a parameter. Raises Refusal for one that does not exist."""
        if key not in self._infos:
            raise Refusal(self._codes["unknown"])
        return self._infos[key]

    def readable(self, key: K) -> ParameterInfo:
        """Return what is known of a parameter that can be read. Raises Refusal."""
        info = self.info(key)
        if "r" not in info.access:
            raise Refusal(self._codes["not readable"])
        return info

    def writable(self, key: K, *, running: bool) -> ParameterInfo:
        """Return what is known of a parameter that can be written now. Raises Refusal."""
        info = self.info(key)
        if "w" not in info.access:
            raise Refusal(self._codes["not writable"])
        if running and info.access == "rw*":
            raise Refusal(self._codes["running"])
        return info

    def must_allow(self, info: ParameterInfo, physical: Decimal) -> None:
        """Raise Refusal for a value that is not within the limits of a parameter."""
        if not info.allows(physical):
            raise Refusal(self._codes["limits"])

    def put(self, place: P, value: V, *, stored: bool = True) -> None:
        """Set what a place holds. stored: in EEPROM, too."""
        self.held[place] = value
        if stored:
            self._eeprom[place] = value

    def power_cycle(self) -> None:
        """Forget what was written to RAM only."""
        self.held = dict(self._eeprom)
