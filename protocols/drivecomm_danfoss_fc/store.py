"""Parameters of a virtual FC drive with their elements, in RAM and in EEPROM, and their descriptions.

Values are kept as raw numbers with a sign; a telegram carries them in two's complement of 16 or 32 bits.
"""

from __future__ import annotations

from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.protocol import ParameterStore, Refusal
from drivecomm_danfoss_fc import description, tables
from drivecomm_danfoss_fc.parameters import DATA_TYPES, RANGES, bits_of, counted, number_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.protocol import Model, Motor, ParameterInfo


_CODES = {
    "unknown": tables.NO_SUCH_PARAMETER,
    "not writable": tables.READ_ONLY,
    "running": tables.NOT_WHILE_RUNNING,
}


class Store(ParameterStore[int, tuple[int, int], int | str]):
    """Parameters of one drive, by number and array index.

    index_base: the index of a first element. without_bus_access: parameters that answer fault 130. factory_set_up:
    whether every write is refused with fault 131.
    """

    def __init__(self, model: Model, index_base: int) -> None:
        infos = {number_of(info.address): info for info in model.parameters.values()}
        self._base = index_base
        first = {number: (number, self._first(info)) for number, info in infos.items()}
        starts = {
            (number, first[number][1] + place): value
            for number, info in infos.items()
            for place, value in enumerate(_starts(info))
        }
        super().__init__(infos, starts, _CODES)
        self._factors = {number: float(info.factor) for number, info in infos.items()}
        self._roles = {str(info.extra.get("role", "")): first[number] for number, info in infos.items()}
        self._shows = {name: first[number_of(address)] for name, address in model.quantities.items()}
        self._poked: set[int] = set()
        self.without_bus_access: set[int] = set()
        self.factory_set_up = False

    def fetch(self, number: int, index: int) -> tuple[int, int]:
        """Return the width in words and the unsigned value of a parameter. Raises Refusal."""
        info = self._on_bus(number)
        value = self._value(self._place(number, index))
        if isinstance(value, str):
            raise Refusal(tables.WRONG_TYPE)
        return bits_of(info.type) // 16, value % 2 ** bits_of(info.type)

    def read_text(self, number: int, index: int) -> str:
        """Return the text of a parameter. Raises Refusal."""
        self._on_bus(number)
        value = self._value(self._place(number, index))
        if isinstance(value, int):
            raise Refusal(tables.NO_TEXT)
        return value

    def option_text(self, number: int, option: int) -> str:
        """Return the text of one option value. Raises Refusal."""
        text = self._on_bus(number).values.get(option)
        if text is None:
            raise Refusal(tables.NO_TEXT)
        return text

    def write(self, number: int, index: int, bits: int, value: int, *, store: bool, running: bool) -> tuple[int, int]:
        """Write an unsigned value of this width; return the same as `fetch`. Raises Refusal."""
        info = self.writable(number, running=running)
        if info.type == "text" or bits != bits_of(info.type):
            raise Refusal(tables.WRONG_TYPE)
        place, number_given = self._place(number, index), counted(value, info.type, bits)
        lowest, highest = limits(info)
        if not lowest <= number_given <= highest:
            raise Refusal(tables.OUTSIDE_LIMITS)
        self.put(place, number_given, stored=store)
        return bits // 16, number_given % 2**bits

    def write_text(self, number: int, index: int, text: str, *, running: bool) -> None:
        """Write a text. Raises Refusal."""
        info = self.writable(number, running=running)
        place = self._place(number, index)
        if info.type != "text":
            raise Refusal(tables.WRONG_TYPE)
        if len(text) > int(info.extra.get("characters", 245)):
            raise Refusal(tables.OUTSIDE_LIMITS)
        self.put(place, text)

    def describe(self, number: int, element: int) -> int | str:
        """Return one element of a parameter's description. Raises Refusal if the parameter does not have it."""
        info = self._on_bus(number)
        if element == description.NAME:
            return info.title
        if element == description.BASIC:
            return self._characteristics(number, info)
        if element == description.ELEMENTS:
            return max(1, _elements(info))
        if info.type == "text":
            raise Refusal(tables.NO_SUCH_ELEMENT)
        if element == description.CONVERSION:
            conversion: int = info.extra.get("conversion_index", 0)
            return conversion % 256 << 8 | description.unit_index(info.unit)
        lowest, highest = limits(info)
        numbers = {
            description.LOWER_LIMIT: lowest,
            description.UPPER_LIMIT: highest,
            description.DEFAULT: _raw(info, info.start),
        }
        if element not in numbers:
            raise Refusal(tables.NO_SUCH_ELEMENT)
        limit: int = numbers[element] % 2 ** bits_of(info.type)
        return limit

    def peek(self, number: int, index: int | None) -> int | str:
        """Return a value as in a telegram, without access checks. Raises Refusal."""
        value = self._value(self._place(number, index))
        return value if isinstance(value, str) else value % 2 ** bits_of(self._infos[number].type)

    def poke(self, number: int, index: int | None, value: int | str) -> None:
        """Set a value in RAM and EEPROM, which also replaces the measurement of the parameter. Raises Refusal."""
        place = self._place(number, index)
        of = self._infos[number].type
        self.put(place, value if isinstance(value, str) else counted(value, of, bits_of(of)))
        self.measured = {each: read for each, read in self.measured.items() if each != place}
        self._poked.add(number)

    # Parameters that the drive itself uses, by their role in the model

    def has(self, role: str) -> bool:
        """Return whether a parameter has this role."""
        return role in self._roles

    def setting(self, role: str, otherwise: float, element: int = 0) -> float:
        """Return a physical value by its role, or `otherwise` if no parameter of this drive has the role."""
        if role not in self._roles:
            return otherwise
        number, first = self._roles[role]
        return int(self.held[number, first + element]) * self._factors[number]

    def fact(self, role: str, key: str, otherwise: int) -> int:
        """Return a number that the model adds to the parameter with this role, or `otherwise` without one."""
        return int(self._infos[self._roles[role][0]].extra.get(key, otherwise)) if role in self._roles else otherwise

    def measure(self, motor: Motor, further: Mapping[str, Callable[[], float]]) -> None:
        """Connect parameters to values of the motor, by common name, and to further values, by role.

        The values are computed when the parameters are read. A value that a telegram writes into such a parameter is
        never seen; a value set by `poke` is.
        """
        shown: dict[Any, Any] = {
            self._shows[name]: partial(motor.measured, name) for name in self._shows if motor.measured(name) is not None
        }
        self.measured = shown | {self._roles[role]: read for role, read in further.items() if role in self._roles}

    def show(self, role: str, value: float, element: int = 0) -> None:
        """Set a physical value in the parameter with this role, unless `poke` has set the parameter."""
        number, first = self._roles.get(role, (0, 0))
        if role in self._roles and number not in self._poked:
            self.put((number, first + element), self._shown(number, value))

    def _value(self, place: tuple[int, int]) -> int | str:
        return self._shown(place[0], self.measured[place]()) if place in self.measured else self.held[place]

    def _shown(self, number: int, value: float) -> int:
        """Return the raw number for a physical value, limited to the range of the parameter's type."""
        allowed = RANGES[self._infos[number].type]
        return max(allowed.start, min(allowed.stop - 1, round(value / self._factors[number])))

    def _on_bus(self, number: int) -> ParameterInfo:
        info = self.info(number)
        if number in self.without_bus_access:
            raise Refusal(tables.NO_BUS_ACCESS)
        return info

    def writable(self, number: int, *, running: bool) -> ParameterInfo:
        """Return the facts about a parameter that can be written now. Raises Refusal."""
        self._on_bus(number)
        info = super().writable(number, running=running and not self.factory_set_up)
        if self.factory_set_up:
            raise Refusal(tables.FACTORY_SET_UP)
        return info

    def _place(self, number: int, index: int | None) -> tuple[int, int]:
        """Return the place of an element, without an index that of the first one. Raises Refusal."""
        info = self.info(number)
        place = number, self._first(info) if index is None else index
        if place not in self.held:
            raise Refusal(tables.NO_SUCH_INDEX if _elements(info) else tables.NOT_AN_ARRAY)
        return place

    def _first(self, info: ParameterInfo) -> int:
        return self._base if _elements(info) else 0

    def _characteristics(self, number: int, info: ParameterInfo) -> int:
        number_of_type = int(info.extra.get("data_type", DATA_TYPES[info.type]))
        differs = self._value(self._place(number, None)) != next(iter(_starts(info)))
        flags = {
            14: bool(_elements(info)),
            12: differs,
            11: info.type == "text",
            10: bool(info.values),
            9: "w" not in info.access,
            8: info.type == "text",
        }
        return number_of_type | sum(1 << bit for bit, on in flags.items() if on)


def limits(info: ParameterInfo) -> tuple[int, int]:
    """Return lower and upper limit as raw numbers: those of the model, the virtual ones, or those of the type."""

    def limit(known: Decimal | None, virtual: str, of_type: int) -> int:
        physical = info.extra.get(virtual) if known is None else known
        return of_type if physical is None else int(Decimal(str(physical)) / info.factor)

    allowed = RANGES[info.type]
    return (
        limit(info.minimum, "virtual_minimum", allowed.start),
        limit(info.maximum, "virtual_maximum", allowed.stop - 1),
    )


def _elements(info: ParameterInfo) -> int:
    return int(info.extra.get("elements", 0))


def _starts(info: ParameterInfo) -> Sequence[int | str]:
    if "starts" in info.extra:
        return [_raw(info, Decimal(each)) for each in str(info.extra["starts"]).split()]
    start: int | str = str(info.start or "") if info.type == "text" else _raw(info, info.start)
    return [start] * max(1, _elements(info))


def _raw(info: ParameterInfo, physical: Decimal | str | None) -> int:
    return int(physical / info.factor) if isinstance(physical, Decimal) else 0
