"""Parameters of Modbus drives: their places in registers and coils.

An address is written as the manual prints it, decimal or `0x...`: `40001`, `0x2000`; `i2103` is an input register,
`c65` a coil, `d3` a discrete input. `.low`, `.high` and `.0` to `.15` are a byte or a bit of a register, which can only
be read.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import RegisterPlace

if TYPE_CHECKING:
    from drivecomm_modbus.options import ModbusOptions

_ADDRESS = re.compile(r"([icd]?)(0x[0-9A-Fa-f]{1,6}|[0-9]{1,7})(?:\.(low|high|[0-9]|1[0-5]))?", re.ASCII)
_COUNTED = re.compile(r"([34])([0-9]{4,5})", re.ASCII)
"""Register numbers in the style of the first Modbus manuals: 4 for holding registers, 3 for input registers."""


def place_of(address: str, options: ModbusOptions) -> RegisterPlace:
    """Return the place of an address as the manual prints it. Raises ParameterAddressError."""
    found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
    if found is None or (found[3] and found[1] in ("c", "d")):
        raise ParameterAddressError(
            f"{address!r} is not an address of a Modbus drive; write 40001, 0x2000, i2103 (input register), c65 (coil) "
            "or 0x2100.low"
        )
    base = options.coil_base if found[1] in ("c", "d") else options.register_base
    start = int(found[2], 0 if found[2].startswith("0x") else 10) - base
    if not 0 <= start <= 0xFFFF:
        hint = counting_hint(address, options)
        outside = f"{address} is not {base} to {base + 0xFFFF}, the registers of this drive"
        raise ParameterAddressError(f"{outside}; {hint}" if hint else outside)
    return RegisterPlace(found[1], start, found[3] or "")


def counting_hint(address: str, options: ModbusOptions) -> str:
    """Return a hint for an address in the usual numbering of manuals, where 40003 is the third register.

    Return an empty text for any other address.
    """
    found = _COUNTED.fullmatch(address)
    if options.register_base or found is None:
        return ""
    first = f"{found[1]}{'1'.rjust(len(found[2]), '0')}"
    write = f" and write i{address} (input register)" if found[1] == "3" else ""
    return f"where the manual counts registers from {first} on, set register_base={first}{write}"


def address_at(place: RegisterPlace, options: ModbusOptions) -> str:
    """Return the address of a place in the numbering of the series' manual."""
    base = options.coil_base if place.is_bit else options.register_base
    return f"{place.kind}{place.start + base}{f'.{place.part}' if place.part else ''}"
