"""Store of a virtual VABus drive: parameters in data sets, in RAM and in EEPROM."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.protocol import ParameterStore, Refusal
from drivecomm_vabus import errorcodes
from drivecomm_vabus.telegrams import data_of, digits_of, number_of, range_of

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo

_CODES = {
    "unknown": errorcodes.UNKNOWN_PARAMETER,
    "not readable": errorcodes.NOT_READABLE,
    "not writable": errorcodes.NOT_WRITABLE,
    "running": errorcodes.NOT_WHILE_RUNNING,
    "limits": errorcodes.VALUE_NOT_PERMITTED,
}


class VabusStore(ParameterStore[int, tuple[int, int], str]):
    """The parameters of one drive, as data characters by number and data set (0 for parameters that exist once).

    measured: functions that return measured raw values, by number.
    """

    def __init__(self, model: Model, *, ram_datasets: bool, lower_case_hex: bool) -> None:
        infos = {int(info.address): info for info in model.parameters.values()}
        starts = {(number, place): _start(info) for number, info in infos.items() for place in _datasets(info)}
        super().__init__(infos, starts, _CODES)
        self._ram_datasets = ram_datasets
        self._lower_case_hex = lower_case_hex

    def fetch(self, number: int, dataset: int) -> str:
        """Return a value as an enquiry reads it. Raises Refusal."""
        info = self.readable(number)
        datasets = _datasets(info)
        if dataset > 4 or (dataset and datasets == (0,)):
            raise Refusal(errorcodes.DATASET_NOT_PERMITTED)
        if number in self.measured:
            allowed = range_of(info.type)
            return data_of(max(allowed[0], min(allowed[-1], round(self.measured[number]()))), info.type)
        values = {self.held[number, place] for place in ((dataset,) if dataset else datasets)}
        if len(values) > 1:
            raise Refusal(errorcodes.DATASETS_DIFFER)
        return values.pop()

    def write(self, number: int, dataset: int, data: str, *, running: bool) -> None:
        """Store a value as a select writes it. Raises Refusal."""
        info = self.writable(number, running=running)
        volatile, place = dataset > 4, dataset % 5
        if (volatile and not self._ram_datasets) or (place and _datasets(info) == (0,)):
            raise Refusal(errorcodes.DATASET_NOT_PERMITTED)
        if info.type != "string":
            self._check(info, data)
            data = data.upper()
        for each in (place,) if place else _datasets(info):
            self.put((number, each), data, stored=not volatile)

    def poke(self, number: int, dataset: int, data: str) -> None:
        """Set a value without checks, as at the keypad, which stores it permanently."""
        for each in (dataset,) if dataset else _datasets(self.info(number)):
            self.put((number, each), data)

    def number(self, number: int) -> int:
        """Return a numeric parameter's raw value in its first data set; 0 if the parameter does not exist."""
        if number not in self._infos:
            return 0
        info = self._infos[number]
        return number_of(self.held[number, _datasets(info)[0]], info.type)

    def _check(self, info: ParameterInfo, data: str) -> None:
        if len(data) != digits_of(info.type):
            raise Refusal(errorcodes.WRONG_LENGTH)
        try:
            number = number_of(data, info.type, lower_case_hex=self._lower_case_hex)
        except ValueError:
            raise Refusal(errorcodes.SYNTAX_ERROR) from None
        self.must_allow(info, number * info.factor)


def _datasets(info: ParameterInfo) -> tuple[int, ...]:
    return (1, 2, 3, 4) if info.extra.get("datasets") == 4 else (0,)


def _start(info: ParameterInfo) -> str:
    if info.type == "string":
        return str(info.start or " ")
    start = info.start if isinstance(info.start, Decimal) else info.minimum or Decimal(0)
    return data_of(int(start / info.factor), info.type)
