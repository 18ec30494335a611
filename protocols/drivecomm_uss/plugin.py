"""The plug-in for USS drives."""

from __future__ import annotations

from drivecomm.profiles import CommandMemory
from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later
from drivecomm_uss.exchanges import BROADCAST, UssOperations
from drivecomm_uss.options import UssOptions
from drivecomm_uss.parameters import address_space, element_addresses
from drivecomm_uss.tasks import error_texts, intent, mismatch, profile
from drivecomm_uss.telegrams import UssCodec, message_from, titled_forms

protocol = Protocol(
    name="uss",
    title="Siemens USS",
    package="drivecomm_uss",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1),
        timing=Timing(
            reply_timeout_s=0.100,
            gap_s=0.050,
            turnaround_s=0.0,
            turnaround_characters=2,
            broadcast_pause_s=0.020,
            late_s=0.25,
            attempts=5,
        ),
    ),
    facts_source=(
        "8E1: USS specification 09.94 B-3.2, B-6, MICROMASTER 420 manual p. 101; 9600 baud: B-5, and the "
        "setting of most drives; a start interval of two characters, after which a drive begins anew (A-8); replies "
        "come within 20 ms (A-9), 100 ms leave room for adapters; five attempts repeat a task until its own reply "
        "comes (C-15); gap, broadcast pause and late replies are printed nowhere, defaults of drivecomm"
    ),
    line_sources={
        **dict.fromkeys(("bytesize", "parity"), "USS specification 09.94 B-3.2, B-6"),
        **dict.fromkeys(("turnaround_characters", "silence_characters"), "USS specification 09.94 A-8"),
    },
    addresses=range(32),
    scan_addresses=range(32),
    default_model="micromaster4",
    broadcast_address=BROADCAST,
    options=UssOptions,
    codec=UssCodec,
    message=message_from,
    mismatch=mismatch,
    operations=UssOperations,
    memory=CommandMemory,
    virtual=later("drivecomm_uss.virtual:VirtualUssDrive"),
    forms=titled_forms,
    parameter_examples=("700", "P2000", "r2024", "2014[0]"),
    control_profiles=lambda: (profile(),),
    intent=intent,
    ambiguous_with={
        "danfoss-fc": (
            "a telegram for a Danfoss FC drive with the address format 1-31 can be one for the USS drive of the same "
            "number, which obeys it, also a start"
        )
    },
    parameter_keys=frozenset({"elements", "full_scale"}),
    element_addresses=element_addresses,
    address_space=address_space,
    silence_characters=2,
    refusals=lambda options, _: error_texts(options.error_family),
)
