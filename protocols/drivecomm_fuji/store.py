"""What a virtual Fuji inverter holds: a data word for each function code of its model."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm_fuji.errorcodes import DATA_ERROR, FUNCTION_ERROR, WRITE_DISABLED
from drivecomm_fuji.formats import PLAIN, Format, current_format
from drivecomm_fuji.parameters import format_of

if TYPE_CHECKING:
    from drivecomm.models import Model, ParameterInfo
    from drivecomm_fuji.options import FujiOptions


class Refusal(Exception):  # noqa: N818 - an answer of the inverter, not an error of the program
    """The inverter refuses with this code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"code {code}")


class Store:
    """The functions of one inverter, as unsigned words; a live value with a sign character is kept negative."""

    def __init__(self, model: Model, options: FujiOptions) -> None:
        self._infos = dict(model.parameters)
        self._formats = {function: _format(info, options) for function, info in self._infos.items()}
        self._sign_functions = options.generation.sign_functions
        self._words: dict[str, int] = {}
        self.initialise()

    def initialise(self, types: str = "") -> None:
        """Give the functions of these types their start values, all functions if none is named."""
        for function, info in self._infos.items():
            if not types or function[0] in types:
                self._words[function] = self._start(info)

    def read(self, function: str) -> int:
        """Return a word as it is read, negative where a sign character stands before it. Raises Refusal."""
        if function not in self._infos or "r" not in self._infos[function].access:
            raise Refusal(FUNCTION_ERROR)
        return self._words[function]

    def word(self, function: str) -> int:
        """Return a word, whoever may read it. Raises ParameterAddressError for a function that does not exist."""
        if function not in self._infos:
            raise ParameterAddressError(f"the virtual drive holds no parameter {function!r}")
        return self._words[function]

    def held(self, function: str) -> int:
        """Return a word, 0 where the inverter does not have this function."""
        return self._words.get(function, 0)

    def check(self, function: str, data: int, *, running: bool) -> None:
        """Raise Refusal if a word from the line cannot be taken."""
        info = self._infos.get(function)
        if info is None:
            raise Refusal(FUNCTION_ERROR)
        if "w" not in info.access or (running and info.access == "rw*"):
            raise Refusal(WRITE_DISABLED)
        try:
            physical = Decimal(self._formats[function].value(data))
        except ValueError:
            raise Refusal(DATA_ERROR) from None
        if (info.minimum is not None and physical < info.minimum) or (
            info.maximum is not None and physical > info.maximum
        ):
            raise Refusal(DATA_ERROR)

    def poke(self, function: str, raw: int) -> None:
        """Set a word without asking. Raises ParameterAddressError for a function that the inverter does not have."""
        self.word(function)
        self._words[function] = raw

    def set(self, function: str, raw: int) -> None:
        """Set a word if the inverter has this function."""
        if function in self._infos:
            self._words[function] = raw

    def copy(self, source: str, destination: str) -> None:
        """Set a word to what another function holds, if the inverter has both."""
        if source in self._infos:
            kept = self._words[source]
            self.set(destination, kept if destination in self._sign_functions else abs(kept))

    def show(self, function: str, physical: float, *, sign_character: bool = False) -> None:
        """Put a measured value into the function that shows it, if there is one, within what four digits can hold."""
        if function not in self._infos:
            return
        known = self._formats[function]
        steps = round(physical / float(known.factor))
        if sign_character:
            self._words[function] = max(-0xFFFF, min(0xFFFF, steps))
        else:
            lowest, highest = (-0x8000, 0x7FFF) if known.signed else (0, 0xFFFF)
            self._words[function] = max(lowest, min(highest, steps)) % 0x10000

    def number(self, function: str, otherwise: float = 0.0) -> float:
        """Return a physical value; the other one where the function or its format is not known."""
        if function not in self._infos or not self._formats[function].known or not self._formats[function].name:
            return otherwise
        return float(self._formats[function].value(self._words[function]))

    def _start(self, info: ParameterInfo) -> int:
        return self._formats[info.address].raw(info.start, info.address) if isinstance(info.start, Decimal) else 0


def _format(info: ParameterInfo, options: FujiOptions) -> Format:
    known = format_of(info.address, info.type, options)
    if known.name == "[19]" and not known.known:
        return current_format(_RATING_HP)
    return known if known.known else PLAIN


_RATING_HP = 10
"""Rating of a virtual inverter that is told none."""
