"""The Danfoss FC protocol as a plug-in of drivecomm."""

from __future__ import annotations

from drivecomm.profiles import CommandMemory
from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later
from drivecomm_danfoss_fc.description import DEFAULT
from drivecomm_danfoss_fc.exchanges import DanfossFcOperations
from drivecomm_danfoss_fc.frames import BROADCAST
from drivecomm_danfoss_fc.messages import intent, mismatch
from drivecomm_danfoss_fc.options import DanfossFcOptions
from drivecomm_danfoss_fc.parameters import address_space, element_addresses
from drivecomm_danfoss_fc.tables import table
from drivecomm_danfoss_fc.telegrams import DanfossFcCodec, message_from, titled_forms
from drivecomm_danfoss_fc.words import profile

_PARAMETER_KEYS = frozenset({
    "characters", "conversion_index", "data_type", "elements", "fc_value", "multi", "role", "starts", "virtual_maximum",
    "virtual_minimum",
})  # fmt: skip

protocol = Protocol(
    name="danfoss-fc",
    title="Danfoss FC protocol",
    package="drivecomm_danfoss_fc",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1),
        timing=Timing(
            reply_timeout_s=0.100,
            gap_s=0.050,
            turnaround_s=0.0,
            turnaround_characters=2,
            broadcast_pause_s=0.0,
            late_s=0.25,
            attempts=3,
        ),
    ),
    facts_source=(
        "8E1: FC 101 Design Guide MG18C502 p. 82 and VLT 6000 manual p. 122; 9600 baud: field drivers; two characters "
        "before the next request: VLT 6000 manual p. 122, VLT 5000 Crane manual p. 97; replies come within 20 ms (same "
        "pages) or 50 ms (VLT 2800 Design Guide p. 108), 100 ms leave room; gap, broadcast pause, late replies and "
        "attempts are printed nowhere, defaults of drivecomm"
    ),
    line_sources={
        **dict.fromkeys(("bytesize", "parity"), "FC 101 Design Guide MG18C502 p. 82"),
        "turnaround_characters": "VLT 6000 manual p. 122, VLT 5000 Crane manual p. 97",
    },
    addresses=range(1, 127),
    scan_addresses=range(1, 32),
    default_model="fc300",
    broadcast_address=BROADCAST,
    options=DanfossFcOptions,
    codec=lambda options: DanfossFcCodec(options.pnu_bits),
    message=message_from,
    mismatch=mismatch,
    operations=DanfossFcOperations,
    memory=CommandMemory,
    virtual=later("drivecomm_danfoss_fc.virtual:VirtualDanfossFcDrive"),
    forms=titled_forms,
    parameter_examples=("16-14", "3-10[3]", "1614", "520", "615[1]"),
    control_profiles=lambda: tuple(profile(profidrive=each) for each in (False, True)),
    intent=intent,
    ambiguous_with={
        "uss": (
            "a telegram for a USS drive can be one for the Danfoss FC drive with the address format 1-31 of the same "
            "number, which obeys it, also a start"
        )
    },
    parameter_keys=_PARAMETER_KEYS,
    element_addresses=element_addresses,
    factory_reading={"element": DEFAULT},
    address_space=address_space,
    refusals=lambda *_: table("faults"),
)
