"""Function codes of a virtual Fuji inverter, each with a data word."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.protocol import ParameterStore, Refusal
from drivecomm_fuji.generations import DATA_ERROR, FUNCTION_ERROR, WRITE_DISABLED
from drivecomm_fuji.words import PLAIN, format_of

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo
    from drivecomm_fuji.options import FujiOptions

_RATING_HP = 10
"""Rating of a virtual inverter for which none is given."""

_CODES = {
    "unknown": FUNCTION_ERROR,
    "not readable": FUNCTION_ERROR,
    "not writable": WRITE_DISABLED,
    "running": WRITE_DISABLED,
    "limits": DATA_ERROR,
}


class Store(ParameterStore[str, str, int]):
    """Functions of one inverter, as unsigned words; a measured value with a sign character is kept negative.

    measured: physical values, by function.
    """

    def __init__(self, model: Model, options: FujiOptions) -> None:
        super().__init__(model.parameters, {}, _CODES)
        rated = replace(options, rating_hp=_RATING_HP if options.rating_hp is None else options.rating_hp)
        formats = {function: format_of(function, info.type, rated) for function, info in self._infos.items()}
        self._formats = {function: found if found.known else PLAIN for function, found in formats.items()}
        self._sign_functions = options.generation.sign_functions
        self._factors = {function: float(known.factor) for function, known in self._formats.items()}
        self._numbers: dict[str, float] = {}
        self.initialise()

    def initialise(self, types: str = "") -> None:
        """Set the functions of these types to their start values; all functions if no type is given."""
        for function, info in self._infos.items():
            if not types or function[0] in types:
                self._put(function, self._start(info))

    def fetch(self, function: str) -> int:
        """Return a word as a read returns it, negative if a sign character is before it. Raises Refusal."""
        self.readable(function)
        return self.word(function)

    def word(self, function: str) -> int:
        """Return a word without access checks. Raises Refusal for a function that does not exist."""
        self.info(function)
        if function in self.measured:
            return self._shown(function, self.measured[function]())
        return self.held[function]

    def word_of(self, function: str) -> int:
        """Return a word that was set; 0 if the inverter does not have this function."""
        return self.held.get(function, 0)

    def check(self, function: str, data: int, *, running: bool) -> None:
        """Raise Refusal if a word from the line is not acceptable."""
        info = self.writable(function, running=running)
        try:
            self.must_allow(info, Decimal(self._formats[function].value(data)))
        except ValueError:
            raise Refusal(DATA_ERROR) from None

    def poke(self, function: str, raw: int) -> None:
        """Set a word without access checks. Raises Refusal for a function that the inverter does not have."""
        self.info(function)
        self._put(function, raw)

    def set(self, function: str, raw: int) -> None:
        """Set a word if the inverter has this function."""
        if function in self._infos:
            self._put(function, raw)

    def keep(self, source: str, physical: float | None, destination: str) -> None:
        """Set one function to the word that another function shows for a value, if the inverter has both.

        physical: the value; None copies the other function's word.
        """
        if source in self._infos:
            word = self.held[source] if physical is None else self._shown(source, physical)
            self.set(destination, word if destination in self._sign_functions else abs(word))

    def number(self, function: str, otherwise: float = 0.0) -> float:
        """Return a physical value, or `otherwise` if the function or its format is unknown."""
        if function in self._numbers:
            return self._numbers[function]
        if function not in self._infos or not self._formats[function].known or not self._formats[function].name:
            return otherwise
        number = self._numbers[function] = float(self._formats[function].value(self.held[function]))
        return number

    def _put(self, function: str, raw: int) -> None:
        self.held[function] = raw
        self._numbers.pop(function, None)

    def _shown(self, function: str, physical: float) -> int:
        """Return the word that shows a value, limited to the range of four digits."""
        steps = round(physical / self._factors[function])
        if function in self._sign_functions:
            return max(-0xFFFF, min(0xFFFF, steps))
        lowest, highest = (-0x8000, 0x7FFF) if self._formats[function].signed else (0, 0xFFFF)
        return max(lowest, min(highest, steps)) % 0x10000

    def _start(self, info: ParameterInfo) -> int:
        return self._formats[info.address].raw(info.start, info.address) if isinstance(info.start, Decimal) else 0
