"""The Fuji protocol as a plug-in of drivecomm."""

from __future__ import annotations

from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later
from drivecomm_fuji.asking import FujiMemory
from drivecomm_fuji.codec import FujiCodec
from drivecomm_fuji.exchanges import FujiOperations
from drivecomm_fuji.generations import PROFILES, error_text
from drivecomm_fuji.options import QUICK_TIMEOUT_S, FujiOptions
from drivecomm_fuji.parameters import address_space
from drivecomm_fuji.telegrams import BROADCAST, STATIONS, intent, message_from, mismatch, titled_forms
from drivecomm_fuji.words import control_profile

_GAP_S = 0.010
"""Shortest time before the host's next request: FVR-E11S manual 9-13. No manual of a later series demands it."""

protocol = Protocol(
    name="fuji",
    title="Fuji Electric general-purpose inverter protocol",
    package="drivecomm_fuji",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="N", stopbits=1),
        timing=Timing(
            reply_timeout_s=QUICK_TIMEOUT_S,
            gap_s=0.050,
            turnaround_s=_GAP_S,
            broadcast_pause_s=_GAP_S,
            late_s=1.0,
            attempts=4,
            least_turnaround_s=_GAP_S,
        ),
    ),
    facts_source=(
        "9600 8N1: a default of drivecomm, the factory setting differs by model; 10 ms before the host speaks: "
        "FVR-E11S manual 9-13; 100 ms to answer: in use for the family, no page read; three repetitions: FRENIC-VG "
        "option manual 5-13; late answers up to 1 s: the longest response interval, FRENIC-VG option manual 5-11, "
        "FRENIC-MEGA manual 5-274; the gap is a default of drivecomm"
    ),
    line_sources={"least_turnaround_s": "FVR-E11S manual 9-13"},
    addresses=STATIONS,
    scan_addresses=STATIONS,
    default_model="frenic",
    broadcast_address=BROADCAST,
    options=FujiOptions,
    codec=lambda options: FujiCodec(PROFILES.get(options.profile), number_check=options.number_check),
    message=message_from,
    mismatch=mismatch,
    operations=FujiOperations,
    memory=FujiMemory,
    virtual=later("drivecomm_fuji.virtual:VirtualFujiDrive"),
    forms=titled_forms,
    parameter_examples=("S05", "M09", "F03", "o05"),
    control_profiles=lambda: (control_profile(),),
    intent=intent,
    parameter_keys=frozenset(),
    plain_writing={"format": "[1]"},
    address_space=address_space,
    refusals=lambda options, _: {code: error_text(code) for code in sorted(options.generation.error_codes)},
)
