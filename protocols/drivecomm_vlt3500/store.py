"""What a virtual VLT holds: parameters, some of them indexed, with decimals, limits and access."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_UP, Decimal
from itertools import product
from typing import TYPE_CHECKING

from drivecomm.protocol import Refusal
from drivecomm_vlt3500.causes import (
    NO_SUCH_INDEX,
    NOT_ACCESSIBLE,
    NOT_INDEXED,
    NOT_WHILE_RUNNING,
    OUT_OF_RANGE,
    READ_ONLY,
    TOO_LONG_TO_SEND,
    UNKNOWN_PARAMETER,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Model, ParameterInfo

_ELEMENT = re.compile(r"(\d+)\[(\d+)(?:,(\d+))?\]", re.ASCII)

_ACTUAL_VALUES = 502

LARGEST = 99_999


class Store:
    """The parameters of one drive as exact decimals. Their start values in the model say with how many decimals.

    factory_setup: while it is active nothing can be written (VLT 3500 manual, page 92, cause 04). measured: what gives
    an actual value, by its index; it is asked when the element is read, which has the decimals of what was set there.
    """

    def __init__(self, model: Model) -> None:
        self.factory_setup = False
        self.measured: Mapping[tuple[int, ...], Callable[[], float]] = {}
        self._infos: dict[int, ParameterInfo] = {}
        self._values: dict[int, Decimal] = {}
        self._numbers: dict[int, float] = {}
        self._elements: dict[int, dict[tuple[int, ...], Decimal]] = {}
        elements = []
        for info in model.parameters.values():
            match = _ELEMENT.fullmatch(info.address)
            if match is None:
                self._add(int(info.address), info)
            else:
                index = tuple(int(part) for part in match.groups()[1:] if part is not None)
                elements.append((int(match[1]), index, _start(info)))
        for number, index, value in elements:
            self._elements.setdefault(number, {})[index] = value

    def _add(self, number: int, info: ParameterInfo) -> None:
        self._infos[number] = info
        sizes = info.extra.get("indexed")
        if sizes is None:
            self._put(number, _start(info))
        else:
            # One dimension: only the elements that the model names. Two: all of them.
            every = product(*map(range, sizes)) if len(sizes) > 1 else ()
            self._elements[number] = dict.fromkeys(every, Decimal(0))

    def fetch(self, number: int) -> Decimal:
        """Return a value as R gets it. Raises Refusal."""
        if number in self._elements:
            raise Refusal(NO_SUCH_INDEX)
        info = self._info(number)
        if "r" not in info.access:
            raise Refusal(NOT_ACCESSIBLE)
        return _sendable(self._values[number])

    def read_index(self, number: int, index: tuple[int, ...]) -> Decimal:
        """Return an element as I gets it. Raises Refusal."""
        if number not in self._elements:
            self._info(number)
            raise Refusal(NOT_INDEXED)
        if index not in self._elements[number]:
            raise Refusal(NO_SUCH_INDEX)
        return _sendable(self._element(number, index))

    def write(self, number: int, value: Decimal, *, running: bool) -> Decimal:
        """Take a value as U brings it, rounded to the parameter's decimals, and return it. Raises Refusal."""
        if number in self._elements:
            raise Refusal(READ_ONLY)
        info = self._info(number)
        if "w" not in info.access or self.factory_setup:
            raise Refusal(READ_ONLY)
        if running and info.access == "rw*":
            raise Refusal(NOT_WHILE_RUNNING)
        if not info.allows(value):
            raise Refusal(OUT_OF_RANGE)
        taken = self._rounded(number, value)
        if taken.adjusted() - int(taken.as_tuple().exponent) > 4 and taken:
            raise Refusal(OUT_OF_RANGE)
        self._put(number, taken)
        return taken

    def poke(self, number: int, index: tuple[int, ...] | None, value: Decimal) -> None:
        """Set a value without asking, with the decimals of the parameter where it has as many. Raises Refusal."""
        if index is None:
            self._info(number)
            if number in self._elements:
                raise Refusal(NO_SUCH_INDEX)
            rounded = self._rounded(number, value)
            self._put(number, rounded if rounded == value else value)
        else:
            before = self.read_index(number, index)
            rounded = value.quantize(before, ROUND_HALF_UP)
            self._elements[number][index] = rounded if rounded == value else value

    def remember(self, number: int, code: int, hours: Decimal) -> None:
        """Put a fault in front of the others in the fault memory, elements (n, 0); (n, 1) is when it was."""
        elements = self._elements.get(number, {})
        for place in sorted({index[0] for index in elements}, reverse=True):
            for column in (0, 1):
                if (place - 1, column) in elements:
                    elements[place, column] = elements[place - 1, column]
        if (0, 0) in elements:
            elements[0, 0], elements[0, 1] = Decimal(code), hours

    def number(self, number: int, default: float = 0.0) -> float:
        """Return a parameter for the drive's own use; the default where it does not exist."""
        return self._numbers.get(number, default)

    def decimals(self, number: int, decimals: int) -> None:
        """Let a parameter have this many decimals from now on."""
        if number in self._values:
            self._put(number, self._values[number].quantize(Decimal((0, (1,), -decimals)), ROUND_HALF_UP))

    def _put(self, number: int, value: Decimal) -> None:
        self._values[number] = value
        self._numbers[number] = float(value)

    def _element(self, number: int, index: tuple[int, ...]) -> Decimal:
        held = self._elements[number][index]
        if number != _ACTUAL_VALUES or index not in self.measured:
            return held
        return Decimal(repr(self.measured[index]())).quantize(held, ROUND_HALF_UP)

    def _info(self, number: int) -> ParameterInfo:
        if number not in self._infos:
            raise Refusal(UNKNOWN_PARAMETER)
        return self._infos[number]

    def _rounded(self, number: int, value: Decimal) -> Decimal:
        return value.quantize(self._values[number], ROUND_HALF_UP) + Decimal(0).quantize(self._values[number])


def _start(info: ParameterInfo) -> Decimal:
    return info.start if isinstance(info.start, Decimal) else Decimal(0)


def _sendable(value: Decimal) -> Decimal:
    """Return a value that fits five digits. Raises Refusal with cause 08 for one that does not."""
    if abs(value).scaleb(-int(value.as_tuple().exponent)) > LARGEST:
        raise Refusal(TOO_LONG_TO_SEND)
    return value
