"""Protocol package for Control Techniques drives over ANSI X3.28."""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm.profiles import register_protocol
from drivecomm.protocol import AddressSpace, LineFacts, LineSettings, Timing
from drivecomm_ct_ansi.dialect import CtDialect
from drivecomm_ct_ansi.telegrams import TELEGRAMS

ADDRESSES = tuple(address for address in range(11, 100) if address % 10)  # unit 0 is a whole group (Mentor MP p. 209)


@dataclass(frozen=True, slots=True, kw_only=True)
class CtOptions:
    """Empty options, since Control Techniques drives have none."""


protocol = register_protocol(
    dialect=CtDialect,
    codec=lambda _options: TELEGRAMS,
    options=CtOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=7, parity="E"),
        timing=Timing(reply_timeout_s=0.25, gap_s=0.05, turnaround_s=0.01, broadcast_pause_s=0.05, late_s=0.5),
    ),
    facts_source=(
        "9600 baud: Commander SE Advanced User Guide p. 14, one of the four rates; 7E1: from memory, as the program "
        "x328-proto has it; all times are defaults"
    ),
    name="ct-ansi",
    title="Control Techniques ANSI (X3.28)",
    package="drivecomm_ct_ansi",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="unidrive-sp",
    parameter_keys=frozenset(),
    address_space=lambda _options, _model: AddressSpace(
        addresses=lambda: (f"{menu:02}.{parameter:02}" for menu in range(23) for parameter in range(100)),
        absent=frozenset({0x04}),
        source="UD70 User Guide p. 6-8; menus up to 22: Unidrive SP",
    ),
    parameter_examples=("01.21", "6.42"),
)
