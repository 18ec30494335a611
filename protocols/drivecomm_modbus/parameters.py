"""Parameters of Modbus drives: where they are, what their registers mean.

An address is what the manual prints, decimal or `0x...`: `40001`, `0x2000`; `i2103` an input register, `c65` a coil,
`d3` a discrete input. `.low`, `.high` and `.0` to `.15` are a byte or a bit of a register, which can only be read.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError, UsageError
from drivecomm.profiles import Place, Target
from drivecomm.protocol import WORD_TYPES, AddressSpace, WordFormat

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model, ParameterInfo
    from drivecomm_modbus.options import ModbusOptions

_ADDRESS = re.compile(r"([icd]?)(0x[0-9A-Fa-f]{1,6}|[0-9]{1,7})(?:\.(low|high|[0-9]|1[0-5]))?", re.ASCII)
_COUNTED = re.compile(r"([34])([0-9]{4,5})", re.ASCII)
"""Registers as the first manuals of Modbus counted them: 4 for holding registers, 3 for input registers."""


def place_of(address: str, options: ModbusOptions) -> Place:
    """Return where an address as the manual prints it is. Raises ParameterAddressError."""
    found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
    if found is None or (found[3] and found[1] in ("c", "d")):
        raise ParameterAddressError(
            f"{address!r} is no address of a Modbus drive; write 40001, 0x2000, i2103 (input register), c65 (coil) or "
            "0x2100.low"
        )
    base = options.coil_base if found[1] in ("c", "d") else options.register_base
    start = int(found[2], 0 if found[2].startswith("0x") else 10) - base
    if not 0 <= start <= 0xFFFF:
        hint = counting_hint(address, options)
        outside = f"{address} is not {base} to {base + 0xFFFF}, the registers of this drive"
        raise ParameterAddressError(f"{outside}; {hint}" if hint else outside)
    return Place(found[1], start, found[3] or "")


def counting_hint(address: str, options: ModbusOptions) -> str:
    """Return what to try for an address as many manuals print registers (40003 is the third); empty for any other."""
    found = _COUNTED.fullmatch(address)
    if options.register_base or found is None:
        return ""
    first = f"{found[1]}{'1'.rjust(len(found[2]), '0')}"
    write = f" and write i{address} (input register)" if found[1] == "3" else ""
    return f"where the manual counts registers from {first} on, set register_base={first}{write}"


def address_at(place: Place, options: ModbusOptions) -> str:
    """Return the address of a place as the manual of the series counts it."""
    base = options.coil_base if place.is_bit else options.register_base
    return f"{place.kind}{place.start + base}{f'.{place.part}' if place.part else ''}"


def by_place(model: Model | None, options: ModbusOptions) -> Mapping[Place, ParameterInfo]:
    """Return the parameters of a model by where they are: the same register may be written as 8448 and as 0x2100."""
    infos = [] if model is None else list(model.parameters.values())
    # Of several at one place the first counts.
    return {place_of(info.address, options): info for info in reversed(infos)}


def target(
    parameter: str,
    model: Model | None,
    options: ModbusOptions,
    type: str = "",
    *,
    places: Mapping[Place, ParameterInfo] | None = None,
) -> Target:
    """Return what is to be read or written. Raises ParameterAddressError.

    type: instead of the model's. places: the model's parameters `by_place`, for who asks often.
    """
    info = model.find(parameter) if model is not None else None
    place = place_of(info.address if info else parameter, options)
    if info is None:
        info = (by_place(model, options) if places is None else places).get(place)
    kind = type or (info.type if info else "")
    if kind and kind not in WORD_TYPES:
        raise UsageError(f"{kind!r} is no type of a Modbus parameter; types are {', '.join(WORD_TYPES)}")
    extra = info.extra if info else {}
    low_first = extra.get("word_order", options.word_order) == "low"
    size = (int(extra.get("characters", 2)) + 1) // 2 if kind == "string" else 2 if kind.endswith("32") else 1
    return Target(
        address=info.address if info else address_at(place, options),
        place=place,
        format=WordFormat(type=kind, size=size, low_first=low_first, allowed=range(2) if place.is_bit else None),
        wide=kind.endswith("32") and not place.kind and options.wide_functions,
        info=info,
        name=info.name if info and parameter == info.name else "",
    )


def address_space(options: ModbusOptions, _model: Model | None) -> AddressSpace:
    """Return the holding registers as the manual of the series counts them; some drives answer 0 for any of them."""
    return AddressSpace(
        addresses=lambda: (str(options.register_base + start) for start in range(0x10000)),
        absent=frozenset({2}),
        source="two bytes name a register, exception 02 says that there is none: G120XA operating instructions p. 168",
    )
