"""WEG drives over WEG's serial protocol, for drivecomm."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.profiles import CONTROL_KEYS, RegisterCommandMemory, RegisterOperations, register_protocol
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_weg.dialect import WegConversation, WegDialect, WegOptions
from drivecomm_weg.telegrams import ADDRESSES, TELEGRAMS

if TYPE_CHECKING:
    from drivecomm.protocol import Model


def _operations(
    address: int, options: WegOptions, model: Model | None, memory: RegisterCommandMemory | None = None
) -> RegisterOperations:
    dialect, known = WegDialect(address, options, model), memory or RegisterCommandMemory()
    return RegisterOperations(dialect, known, WegConversation(dialect, known))


protocol = register_protocol(
    dialect=WegDialect,
    codec=lambda _options: TELEGRAMS,
    options=WegOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=7, parity="E"),
        timing=Timing(reply_timeout_s=0.1, gap_s=0.05, turnaround_s=0.03, broadcast_pause_s=0.05, late_s=0.5),
    ),
    facts_source=(
        "7E1: MVW3000 manual p. 9-16, CFW-08 manual p. 137; 30 ms between telegrams, above "
        "10 + 2 + 15 ms: CFW-08 p. 144, CFW-09 p. 306; 9600 baud is on no page; the reply time, the gap and late "
        "replies are our defaults"
    ),
    name="weg",
    title="WEG serial protocol",
    package="drivecomm_weg",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="cfw-08",
    operations=_operations,
    control_keys=CONTROL_KEYS | {"identity"},
    ambiguous_with={"vabus": "a VABus enquiry of parameter 700 to 999 is a read of the WEG drive of the same number"},
    parameter_examples=("P003", "V02"),
)
