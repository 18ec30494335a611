"""The plug-in for drives with the VLT 3500 telegram."""

from __future__ import annotations

from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later, tables_beside
from drivecomm_vlt3500.codec import blind_spots, intent, message_from, mismatch
from drivecomm_vlt3500.commands import VltMemory
from drivecomm_vlt3500.exchanges import VltOperations
from drivecomm_vlt3500.options import VltOptions
from drivecomm_vlt3500.parameters import address_space, element_addresses
from drivecomm_vlt3500.telegrams import ADDRESSES, BROADCAST, telegrams
from drivecomm_vlt3500.words import profile

protocol = Protocol(
    name="vlt3500",
    title="Danfoss VLT Series 3500, 3000 and 2000",
    package="drivecomm_vlt3500",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="N"),
        timing=Timing(
            reply_timeout_s=0.25,
            gap_s=0.050,
            gap_characters=5,
            turnaround_s=0.010,
            broadcast_pause_s=0.010,
            late_s=1.0,
            attempts=3,
        ),
    ),
    facts_source=(
        "8N1: VLT Series 3500 manual, printed page 85, VLT 3000 manual p. 73; the list of speeds and the factory speed "
        "are on pages not seen, 9600 baud is a default of drivecomm; no time is printed anywhere: 250 ms, 50 ms, 10 ms "
        "and three transmissions are defaults of drivecomm (later drives answer within 50 ms)"
    ),
    line_sources=dict.fromkeys(("bytesize", "parity"), "VLT Series 3500 manual, printed page 85"),
    addresses=ADDRESSES,
    scan_addresses=range(1, 32),
    default_model="vlt3500",
    broadcast_address=BROADCAST,
    options=VltOptions,
    codec=lambda options: telegrams(lenient=options.lenient_status),
    message=message_from,
    mismatch=mismatch,
    operations=VltOperations,
    memory=VltMemory,
    virtual=later("drivecomm_vlt3500.virtual:VirtualVltDrive"),
    blind_spots=blind_spots,
    forms=lambda: telegrams().forms,
    parameter_examples=("516", "502[17]", "602[13,5]"),
    intent=intent,
    parameter_keys=frozenset({"decimals", "indexed", "limits", "note"}),
    element_addresses=element_addresses,
    address_space=address_space,
    control_profiles=lambda: (profile(),),
    refusals=lambda *_: {int(code): text for code, text in tables_beside(__file__, "tables.toml")["causes"].items()},
)
