"""The registers that a Modbus drive may hold, and its refusal of others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace
from drivecomm_modbus.control import control_of
from drivecomm_modbus.functions import UNKNOWN_ADDRESS

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions


def address_space(options: ModbusOptions, model: Model | None) -> AddressSpace:
    """Return the holding registers in the numbering of the series' manual; some drives answer 0 for any unused one."""
    refused = control_of(model, options).refusals.get("unknown", UNKNOWN_ADDRESS)
    return AddressSpace(
        addresses=lambda: (str(options.register_base + start) for start in range(0x10000)),
        absent=frozenset({refused}),
        source="two bytes name a register; exception 02 says that there is none, unless the model of the series has "
        "another one for that: G120XA operating instructions p. 168",
    )
