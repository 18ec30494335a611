"""Store of a virtual VLT: parameters, some of them indexed, with decimals, limits and access."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal
from itertools import product
from typing import TYPE_CHECKING

from drivecomm.protocol import ParameterStore, Refusal
from drivecomm_vlt3500 import parameters as causes
from drivecomm_vlt3500.parameters import target

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo

_CODES = {
    "unknown": causes.UNKNOWN_PARAMETER,
    "not readable": causes.NOT_ACCESSIBLE,
    "not writable": causes.READ_ONLY,
    "running": causes.NOT_WHILE_RUNNING,
    "limits": causes.OUT_OF_RANGE,
}
_ACTUAL_VALUES = 502

LARGEST = 99_999


class VltStore(ParameterStore[int, tuple[int, tuple[int, ...] | None], Decimal]):
    """The parameters of one drive as exact decimals; the start values in the model define the number of decimals.

    factory_setup: while it is active, no parameter can be written (VLT 3500 manual, page 92, cause 04). measured:
    functions for actual values, by index; each value has the decimals of its start value.
    """

    def __init__(self, model: Model) -> None:
        infos: dict[int, ParameterInfo] = {}
        starts: dict[tuple[int, tuple[int, ...] | None], Decimal] = {}
        self._indexed: set[int] = set()
        for info in model.parameters.values():
            place = target(info.address, None)
            sizes = info.extra.get("indexed")
            if place.index is None:
                infos[place.number] = info
            if place.index is not None or sizes is not None:
                self._indexed.add(place.number)
            if sizes is None:
                starts[place.number, place.index] = info.start if isinstance(info.start, Decimal) else Decimal(0)
            elif len(sizes) > 1:
                # With one dimension only the elements in the model exist, with two dimensions all of them.
                for index in product(*map(range, sizes)):
                    starts.setdefault((place.number, index), Decimal(0))
        super().__init__(infos, starts, _CODES)
        self.factory_setup = False

    def fetch(self, number: int, index: tuple[int, ...] | None) -> Decimal:
        """Return a value as R reads it, or an element as I reads it. Raises Refusal."""
        if index is None and number not in self._indexed:
            self.readable(number)
        elif number not in self._indexed:
            self.info(number)
            raise Refusal(causes.NOT_INDEXED)
        elif (number, index) not in self.held:
            raise Refusal(causes.NO_SUCH_INDEX)
        held = self.held[number, index]
        if number == _ACTUAL_VALUES and index is not None and index in self.measured:
            held = Decimal(repr(self.measured[index]())).quantize(held, ROUND_HALF_UP)
        if abs(held).scaleb(-int(held.as_tuple().exponent)) > LARGEST:
            raise Refusal(causes.TOO_LONG_TO_SEND)
        return held

    def write(self, number: int, value: Decimal, *, running: bool) -> Decimal:
        """Store a value as U writes it, rounded to the parameter's decimals, and return it. Raises Refusal."""
        if number in self._indexed or (number in self._infos and self.factory_setup):
            raise Refusal(causes.READ_ONLY)
        self.must_allow(self.writable(number, running=running), value)
        taken = self._rounded(number, value)
        if taken.adjusted() - int(taken.as_tuple().exponent) > 4 and taken:
            raise Refusal(causes.OUT_OF_RANGE)
        self.put((number, None), taken)
        return taken

    def poke(self, number: int, index: tuple[int, ...] | None, value: Decimal) -> None:
        """Set a value without checks, with the decimals of the parameter unless it has more. Raises Refusal."""
        if index is not None:
            self.fetch(number, index)
        elif number in self._indexed:
            raise Refusal(causes.NO_SUCH_INDEX)
        else:
            self.info(number)
        rounded = self._rounded(number, value, index)
        self.put((number, index), rounded if rounded == value else value)

    def remember(self, number: int, code: int, hours: Decimal) -> None:
        """Insert a fault at the front of the fault memory: code in elements (n, 0), hours in (n, 1)."""
        held = {index: value for (each, index), value in self.held.items() if each == number and index}
        for (place, *column), value in held.items():
            if (place + 1, *column) in held and column in ([0], [1]):
                self.put((number, (place + 1, *column)), value)
        if (0, 0) in held:
            self.put((number, (0, 0)), Decimal(code))
            self.put((number, (0, 1)), hours)

    def number(self, number: int, default: float = 0.0) -> float:
        """Return a parameter for the drive's own use; the default if it does not exist."""
        return float(self.held.get((number, None), default))

    def decimals(self, number: int, decimals: int) -> None:
        """Set the number of decimals of a parameter."""
        if (number, None) in self.held:
            value = self.held[number, None]
            self.put((number, None), value.quantize(Decimal((0, (1,), -decimals)), ROUND_HALF_UP))

    def _rounded(self, number: int, value: Decimal, index: tuple[int, ...] | None = None) -> Decimal:
        held = self.held[number, index]
        return value.quantize(held, ROUND_HALF_UP) + Decimal(0).quantize(held)
