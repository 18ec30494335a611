"""Parameter values of a virtual drive in RAM and in EEPROM, and the refusals of access to them.

A key names a parameter, for example by a number. A place names one of its values, for example by a number with a data
set or an index.
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

    infos: facts about each parameter, by key. starts: the initial value of each place. codes: the codes of the protocol
    with which the drive refuses, by reason: unknown, not readable, not writable, running, limits. held: the present
    value of each place. measured: functions that return the values of places which show a measurement; they are called
    for each read, so that no read returns a value set there.
    """

    def __init__(self, infos: Mapping[K, ParameterInfo], starts: Mapping[P, V], codes: Mapping[str, int]) -> None:
        self.held = dict(starts)
        self.measured: Mapping[Any, Callable[[], float]] = {}
        self._eeprom = dict(starts)
        self._infos = dict(infos)
        self._codes = codes

    def info(self, key: K) -> ParameterInfo:
        """Return the facts about a parameter. Raises Refusal if it does not exist."""
        if key not in self._infos:
            raise Refusal(self._codes["unknown"])
        return self._infos[key]

    def readable(self, key: K) -> ParameterInfo:
        """Return the facts about a parameter that can be read. Raises Refusal otherwise."""
        info = self.info(key)
        if "r" not in info.access:
            raise Refusal(self._codes["not readable"])
        return info

    def writable(self, key: K, *, running: bool) -> ParameterInfo:
        """Return the facts about a parameter that can be written now. Raises Refusal otherwise."""
        info = self.info(key)
        if "w" not in info.access:
            raise Refusal(self._codes["not writable"])
        if running and info.access == "rw*":
            raise Refusal(self._codes["running"])
        return info

    def must_allow(self, info: ParameterInfo, physical: Decimal) -> None:
        """Raise Refusal for a value outside the limits of a parameter."""
        if not info.allows(physical):
            raise Refusal(self._codes["limits"])

    def put(self, place: P, value: V, *, stored: bool = True) -> None:
        """Set the value of a place.

        stored: whether the value goes to EEPROM, too.
        """
        self.held[place] = value
        if stored:
            self._eeprom[place] = value

    def power_cycle(self) -> None:
        """Restore the values of EEPROM, so that writes to RAM alone are lost."""
        self.held = dict(self._eeprom)
