"""Parameter addresses and values: what `2000`, `P0700`, `2014[0]` and `output_frequency` mean, and how values look."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from decimal import Decimal
from math import isfinite
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.protocol import Reading, Value, exact, scaled, unscaled

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo
    from drivecomm_uss.options import UssOptions

RANGES = {"U16": range(2**16), "I16": range(-(2**15), 2**15), "U32": range(2**32), "I32": range(-(2**31), 2**31)}
TYPES = (*RANGES, "Float")
PAGE = 2000
_HIGHEST = {"page": 64 * PAGE, "masterdrives": 2 * PAGE, "nord": 2048, "plain": 2048}
_ADDRESS = re.compile(r"[PpRr]?(?P<number>\d{1,6})(?:\[(?P<index>\d{1,3})\])?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A parameter with what is known about it; index is None for one that is no array and was named without one."""

    number: int
    index: int | None
    parameter_set: int
    type: str
    info: ParameterInfo | None

    @property
    def address(self) -> str:
        """The parameter address as text."""
        return str(self.number) if self.index is None else f"{self.number}[{self.index}]"

    @property
    def double(self) -> bool:
        """Whether the type takes a double word."""
        return self.type in ("U32", "I32", "Float")


def target(
    parameter: str,
    model: Model | None,
    options: UssOptions,
    *,
    type: str = "",
    index: int | None = None,
    parameter_set: int = 1,
) -> Target:
    """Return what a parameter address or a name of the model means. Raises ParameterAddressError."""
    name, opening, rest = parameter.partition("[")
    known = model.find(name) if model else None
    match = _ADDRESS.fullmatch((known.address if known else name) + opening + rest)
    if match is None:
        raise ParameterAddressError(f"{parameter!r} is no USS parameter address such as 2000, P0700 or 2014[0]")
    number, written = int(match["number"]), match["index"]
    if number >= _HIGHEST[options.ind]:
        raise ParameterAddressError(f"parameter {number} cannot be reached: the highest is {_HIGHEST[options.ind] - 1}")
    info = known or (model.find(str(number)) if model else None)
    if written is not None:
        if index is not None and index != int(written):
            raise UsageError(f"{parameter} names index {written}, and index={index} another")
        index = int(written)
    if index is None and info is not None and "elements" in info.extra:
        index = options.index_base
    allowed = range(64 if options.ind == "nord" else 255)
    if index is not None and (type_of(index) is not int or index not in allowed):
        raise ParameterAddressError(f"index {index!r} of parameter {number} is not 0 to {allowed.stop - 1}")
    if type_of(parameter_set) is not int or parameter_set not in range(1, 5 if options.ind == "nord" else 2):
        raise ParameterAddressError(f"parameter set {parameter_set!r} does not exist; NORD drives have 1 to 4")
    chosen = type or (info.type if info else "")
    if chosen not in ("", *TYPES):
        raise UsageError(f"{chosen!r} is no type of USS parameters; they are {', '.join(TYPES)}")
    return Target(number=number, index=index, parameter_set=parameter_set, type=chosen, info=info)


type_of = type


def element_addresses(info: ParameterInfo, options: UssOptions) -> tuple[str, ...]:
    """Return the addresses of a parameter's values: of each element of an array, or the one there is."""
    count = int(info.extra.get("elements", 0))
    return tuple(f"{info.address}[{options.index_base + place}]" for place in range(count)) or (info.address,)


def reading_of(wanted: Target, raw: int, bits: int) -> Reading:
    """Return the reading of an unsigned value of so many bits, as AK of the reply says."""
    info, note = wanted.info, ""
    plain = Reading(parameter=wanted.address, name=info.name if info else "", raw=raw, value=raw)
    if not wanted.type or wanted.double is not (bits == 32):
        note = f"the drive answered {wanted.type} with {bits} bits" if wanted.type else "type not known"
        return _noted(plain, f"{note}: this is the unsigned number as sent")
    if wanted.type == "Float":
        number = shortest_decimal(raw)
        if number is None:
            return _noted(plain, "no number: these are the 32 bits as sent")
        value: int | Decimal = number
    else:
        value = raw - 2**bits if raw not in RANGES[wanted.type] else raw
    if info is None:
        return _noted(replace_value(plain, value, wanted.type), "scale not known: this is the number as sent")
    return Reading(
        parameter=wanted.address,
        name=info.name,
        raw=raw,
        value=value * info.factor if isinstance(value, Decimal) else scaled(value, info.factor),
        unit=info.unit,
        type=wanted.type,
        text=info.values.get(int(value), ""),
        note="" if info.sure == "printed" else f"type and unit are {info.sure}",
    )


def _noted(reading: Reading, note: str) -> Reading:
    return replace(reading, note=note)


def replace_value(reading: Reading, value: Value, type: str) -> Reading:
    """Return a reading with another value and its type."""
    return replace(reading, value=value, type=type)


def shortest_decimal(bits: int) -> Decimal | None:
    """Return the shortest decimal that gives the same 32-bit float, None for what is no number."""
    number = struct.unpack(">f", bits.to_bytes(4, "big"))[0]
    if not isfinite(number):
        return None
    texts = (f"{number:.{digits}g}" for digits in range(1, 10))
    return _plain(Decimal(next(text for text in texts if float_bits(float(text)) == bits)))


def _plain(number: Decimal) -> Decimal:
    return number.quantize(Decimal(1)) if number == number.to_integral_value() and abs(number) < 10**9 else number


def float_bits(number: float) -> int | None:
    """Return the bits of the 32-bit float that is nearest to a number, None where there is none."""
    try:
        return int.from_bytes(struct.pack(">f", number), "big")
    except OverflowError:
        return None


def raw_for(wanted: Target, value: Value | float) -> int:
    """Return the unsigned number that carries a value. Raises ValueRefusedError for one that does not fit."""
    info = wanted.info
    if not wanted.type:
        raise UsageError(
            f"the type of parameter {wanted.address} is not known, so its value cannot be written; "
            f"name a model or give type= ({', '.join(TYPES)})"
        )
    number = exact(value, wanted.address)
    if info is not None:
        below = info.minimum is not None and number < info.minimum
        if below or (info.maximum is not None and number > info.maximum):
            raise ValueRefusedError(f"{number} for parameter {wanted.address} is outside its limits")
    if wanted.type == "Float":
        bits = float_bits(float(number / (info.factor if info else 1)))
        back = None if bits is None else shortest_decimal(bits)
        if bits is None or back is None or back * (info.factor if info else 1) != number:
            raise ValueRefusedError(f"{value} for parameter {wanted.address} is no 32-bit float; it is not rounded")
        return bits
    raw = unscaled(number, info.factor if info else Decimal(1), wanted.address, info.unit if info else "")
    if raw not in RANGES[wanted.type]:
        raise ValueRefusedError(f"{value} for parameter {wanted.address} is {raw} on the wire, beyond {wanted.type}")
    return raw % (2**32 if wanted.double else 2**16)
