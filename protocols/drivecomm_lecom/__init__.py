"""Lenze drives over LECOM-A/B for drivecomm."""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm.profiles import CONTROL_KEYS, register_protocol
from drivecomm.protocol import AddressSpace, LineFacts, LineSettings, Timing
from drivecomm_lecom.dialect import LecomDialect
from drivecomm_lecom.telegrams import CODES, TELEGRAMS

ADDRESSES = tuple(address for address in range(1, 100) if address % 10)  # multiples of ten are groups (L p. 6-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class LecomOptions:
    """LECOM drives have no options."""


protocol = register_protocol(
    dialect=LecomDialect,
    codec=lambda _options: TELEGRAMS,
    options=LecomOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="N"),
        timing=Timing(reply_timeout_s=0.1, gap_s=0.05, turnaround_s=0.002, broadcast_pause_s=0.05, late_s=0.5),
    ),
    facts_source=(
        "10 bits a character, 20 ms to process: 8200 motec EDB82MV752 p. 6-10; 9600 8N1 as delivered: on no page that "
        "was seen; the reply time, the gap, the turnaround, the pause, late replies and attempts are defaults"
    ),
    name="lecom",
    title="Lenze LECOM-A/B",
    package="drivecomm_lecom",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="lenze-82xx",
    parameter_keys=frozenset(),
    control_keys=CONTROL_KEYS | {"identity"},
    address_space=lambda _options, _model: AddressSpace(
        addresses=lambda: (f"C{code:04d}" for code in CODES), absent=frozenset({0x04}), source="L p. 8-16 and 8-21"
    ),
    line_errors={"kind": frozenset({"fault"})},
    parameter_examples=("C0046", "C0410/3", "P103"),
)
