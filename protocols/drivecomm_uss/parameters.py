"""Parameter addresses such as `2000`, `P0700`, `2014[0]` and `output_frequency`, and the conversion of their values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.protocol import (
    AddressSpace,
    Elements,
    Value,
    exact,
    float_bits,
    float_of,
    must_know_type,
    new_reading,
    scaled,
    whole_number,
)
from drivecomm_uss.parameter_area import PAGE, numbers_of, values_of
from drivecomm_uss.tasks import NO_ARRAY, NO_INDEX, NO_NUMBER

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo, Reading
    from drivecomm_uss.messages import Words
    from drivecomm_uss.options import UssOptions

RANGES = {"U16": range(2**16), "I16": range(-(2**15), 2**15), "U32": range(2**32), "I32": range(-(2**31), 2**31)}
_TYPES = (*RANGES, "Float")
DOUBLE = frozenset({"U32", "I32", "Float"})
"""Types that need a double word."""
_ADDRESS = re.compile(r"[PpRr]?(?P<number>\d{1,6})(?:\[(?P<index>\d{1,3})\])?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class UssTarget:
    """A parameter with its model data. index: None for one that is not an array and was named without an index."""

    number: int
    index: int | None
    parameter_set: int
    type: str
    info: ParameterInfo | None

    @property
    def address(self) -> str:
        """The parameter address as text."""
        return str(self.number) if self.index is None else f"{self.number}[{self.index}]"

    def place_in(self, options: UssOptions) -> dict[str, Any]:
        """Return the telegram fields that name this parameter."""
        paged = len(values_of("page", options.ind)) > 1
        page, pnu = divmod(self.number, PAGE) if paged else (None, self.number)
        parameter_set = self.parameter_set if options.ind == "nord" else None
        return {"pnu": pnu, "page": page, "index": self.index or 0, "parameter_set": parameter_set}


def words_of(raw: int, type: str, options: UssOptions) -> Words | None:
    """Return all words of PWE if there are more than the value, as for negative words on NORD drives (p. 42).

    Return None if the value is enough.
    """
    negative = type == "I16" and raw >= 2**15
    return (0xFFFF, raw) if negative and options.ind == "nord" and options.pkw_words == 4 else None


def target(
    parameter: str,
    model: Model | None,
    options: UssOptions,
    *,
    type: str = "",
    index: int | None = None,
    parameter_set: int = 1,
) -> UssTarget:
    """Return the target of a parameter address or of a name in the model. Raises ParameterAddressError."""
    name, opening, rest = parameter.partition("[")
    known = model.find(name) if model else None
    match = _ADDRESS.fullmatch((known.address if known else name) + opening + rest)
    if match is None:
        raise ParameterAddressError(f"{parameter!r} is not a USS parameter address such as 2000, P0700 or 2014[0]")
    number, written = int(match["number"]), match["index"]
    _must_be("parameter number", number, numbers_of(options.ind))
    info = known or (model.find(str(number)) if model else None)
    if written is not None:
        if index is not None and index != int(written):
            raise UsageError(f"{parameter} names index {written}, and index={index} another")
        index = int(written)
    if index is None and info is not None and "elements" in info.extra:
        index = options.index_base
    if index is not None:
        # Index 255 requests all elements in one telegram.
        _must_be("index", index, range(min(255, values_of("index", options.ind).stop)))
    _must_be("parameter set", parameter_set, values_of("parameter_set", options.ind))
    chosen = type or (info.type if info else "")
    if chosen not in ("", *_TYPES):
        raise UsageError(f"{chosen!r} is not a type of USS parameters; they are {', '.join(_TYPES)}")
    return UssTarget(number=number, index=index, parameter_set=parameter_set, type=chosen, info=info)


def _must_be(what: str, given: object, allowed: range) -> None:
    if type(given) is not int or given not in allowed:
        raise ParameterAddressError(f"{what} {given!r} does not exist; there are {allowed.start} to {allowed.stop - 1}")


def element_addresses(info: ParameterInfo, options: UssOptions) -> tuple[str, ...]:
    """Return the addresses of a parameter's values: of each element of an array, or its only one."""
    count = int(info.extra.get("elements", 0))
    return tuple(f"{info.address}[{options.index_base + place}]" for place in range(count)) or (info.address,)


def reading_of(wanted: UssTarget, raw: int, bits: int) -> Reading:
    """Return the reading of an unsigned value. bits: its size, as AK of the reply gives it."""
    info, type_, unit, text = wanted.info, wanted.type, "", ""
    value: Value = raw
    note = doubt = ""
    if not type_:
        note = "type not known: this is the unsigned number as sent"
    elif (type_ in DOUBLE) is not (bits == 32):
        doubt, type_ = f"the drive answered {type_} with {bits} bits: this is the unsigned number as sent", ""
    elif (number := number_of(raw, type_)) is None:
        doubt, type_ = "not a number: these are the 32 bits as sent", ""
    elif info is None:
        value, note = number, "scale not known: this is the number as sent"
    else:
        value = number * info.factor if isinstance(number, Decimal) else scaled(number, info.factor)
        unit, text = info.unit, info.values.get(int(number), "")
        note = info.note
    name = info.name if info else ""
    return new_reading(
        parameter=wanted.address,
        name=name,
        raw=raw,
        value=value,
        unit=unit,
        type=type_,
        text=text,
        note=note,
        doubt=doubt,
    )


def number_of(raw: int, type: str) -> int | Decimal | None:
    """Return the unscaled number for an unsigned number from the wire; None for a float that is not a number."""
    if type == "Float":
        return float_of(raw)
    return raw if raw in RANGES[type] else raw - len(RANGES[type])


def raw_for(wanted: UssTarget, value: Value | float) -> int:
    """Return the unsigned number that carries a value. Raises ValueRefusedError for a value that does not fit."""
    info = wanted.info
    must_know_type(wanted.type, _TYPES, wanted.address)
    if wanted.type != "Float":
        allowed = RANGES[wanted.type]
        raw = whole_number(value, wanted.address, info, wanted.type, allowed)
        return raw % len(allowed)
    number, factor = exact(value, wanted.address), info.factor if info else Decimal(1)
    if info is not None:
        info.check(number)
    bits = float_bits(float(number / factor))
    back = None if bits is None else number_of(bits, "Float")
    if bits is None or back is None or back * factor != number:
        raise ValueRefusedError(f"{value} for parameter {wanted.address} is not a 32-bit float; it is not rounded")
    return bits


def address_space(options: UssOptions, _model: Model | None) -> AddressSpace:
    """Return the addresses that a drive of this series can hold; the printed table of pages ends with 29999."""
    return AddressSpace(
        addresses=lambda: map(str, numbers_of(options.ind)[:30_000]),
        absent=frozenset({NO_NUMBER, NO_INDEX, NO_ARRAY}),
        source="USS specification C-8 to C-13: numbers and index word; C-14: error numbers 0, 3 and 4",
        elements=_elements,
    )


def _elements(address: str, code: int | None) -> Elements:
    if code not in (None, NO_INDEX):
        return Elements()
    return Elements(runs=(tuple(f"{address}[{index}]" for index in range(1, 255)),))
