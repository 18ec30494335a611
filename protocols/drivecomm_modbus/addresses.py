"""Which registers a Modbus drive may hold: all holding registers that a telegram can name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_REGISTERS = 0x10000
_NO_SUCH_ADDRESS = 2


def address_space(options: ModbusOptions, _model: Model | None) -> AddressSpace:
    """Return the holding registers as the manual of the series counts them; some drives answer 0 for any of them."""
    return AddressSpace(
        addresses=lambda: (str(options.register_base + start) for start in range(_REGISTERS)),
        absent=frozenset({_NO_SUCH_ADDRESS}),
        source="two bytes name a register, exception 02 says that there is none: G120XA operating instructions p. 168",
    )
