"""What a virtual VABus drive holds: parameters in data sets, in RAM and in EEPROM."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.protocol import Refusal
from drivecomm_vabus.errorcodes import (
    DATASET_NOT_PERMITTED,
    DATASETS_DIFFER,
    NOT_READABLE,
    NOT_WHILE_RUNNING,
    NOT_WRITABLE,
    SYNTAX_ERROR,
    UNKNOWN_PARAMETER,
    VALUE_NOT_PERMITTED,
    WRONG_LENGTH,
)
from drivecomm_vabus.telegrams import data_of, number_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Model, ParameterInfo


_LIMITS = {"uint": (0, 2**16 - 1), "int": (-(2**15), 2**15 - 1), "long": (-(2**31), 2**31 - 1)}


class Store:
    """The parameters of one drive, as data characters by number and data set (0 for those that exist once).

    measured: what gives the raw value of a parameter that shows one; it is asked when the parameter is read, so that
    nothing set there is ever seen.
    """

    def __init__(self, model: Model, *, ram_datasets: bool) -> None:
        self._infos: dict[int, ParameterInfo] = {int(info.address): info for info in model.parameters.values()}
        self._ram_datasets = ram_datasets
        self.measured: Mapping[int, Callable[[], float]] = {}
        self._eeprom = {
            (number, dataset): _start(info) for number, info in self._infos.items() for dataset in _datasets(info)
        }
        self._ram = dict(self._eeprom)

    def power_cycle(self) -> None:
        """Forget what was written to RAM only."""
        self._ram = dict(self._eeprom)

    def info(self, number: int) -> ParameterInfo:
        """Return what is known of a parameter. Raises Refusal for one that does not exist."""
        if number not in self._infos:
            raise Refusal(UNKNOWN_PARAMETER)
        return self._infos[number]

    def fetch(self, number: int, dataset: int) -> str:
        """Return a value as an enquiry gets it. Raises Refusal."""
        info = self.info(number)
        if "r" not in info.access:
            raise Refusal(NOT_READABLE)
        datasets = _datasets(info)
        if dataset > 4 or (dataset and datasets == (0,)):
            raise Refusal(DATASET_NOT_PERMITTED)
        if number in self.measured:
            return _shown(self.measured[number](), info.type or "int")
        if dataset or datasets == (0,):
            return self._ram[number, dataset]
        values = {self._ram[number, each] for each in datasets}
        if len(values) > 1:
            raise Refusal(DATASETS_DIFFER)
        return values.pop()

    def write(self, number: int, dataset: int, data: str, *, running: bool) -> None:
        """Take a value as a select brings it. Raises Refusal."""
        info = self.info(number)
        if "w" not in info.access:
            raise Refusal(NOT_WRITABLE)
        if running and info.access == "rw*":
            raise Refusal(NOT_WHILE_RUNNING)
        volatile, place = dataset > 4, dataset % 5
        if (volatile and not self._ram_datasets) or (place and _datasets(info) == (0,)):
            raise Refusal(DATASET_NOT_PERMITTED)
        _check(info, data)
        for each in (place,) if place else _datasets(info):
            self._ram[number, each] = data
            if not volatile:
                self._eeprom[number, each] = data

    def poke(self, number: int, dataset: int, data: str) -> None:
        """Set a value without asking, as at the keypad, which stores it."""
        for each in (dataset,) if dataset else _datasets(self.info(number)):
            self._ram[number, each] = self._eeprom[number, each] = data

    def number(self, number: int) -> int:
        """Return a numeric parameter's raw value in the first data set that it has, 0 if it does not exist."""
        if number not in self._infos:
            return 0
        info = self._infos[number]
        return number_of(self._ram[number, _datasets(info)[0]], info.type)  # type: ignore[arg-type]


def _datasets(info: ParameterInfo) -> tuple[int, ...]:
    return (1, 2, 3, 4) if info.extra.get("datasets") == 4 else (0,)


def _start(info: ParameterInfo) -> str:
    if info.type == "string":
        return str(info.start or " ")
    start = info.start if isinstance(info.start, Decimal) else info.minimum or Decimal(0)
    return data_of(int(start / info.factor), info.type)  # type: ignore[arg-type]


def _shown(value: float, type: str) -> str:
    """Return the data characters of a measured value, as far as the parameter's type reaches."""
    lowest, highest = _LIMITS[type]
    return data_of(max(lowest, min(highest, round(value))), type)  # type: ignore[arg-type]


def _check(info: ParameterInfo, data: str) -> None:
    if info.type == "string":
        return
    if len(data) != (8 if info.type == "long" else 4):
        raise Refusal(WRONG_LENGTH)
    try:
        physical = number_of(data, info.type) * info.factor  # type: ignore[arg-type]
    except ValueError:
        raise Refusal(SYNTAX_ERROR) from None
    if not info.allows(physical):
        raise Refusal(VALUE_NOT_PERMITTED)
