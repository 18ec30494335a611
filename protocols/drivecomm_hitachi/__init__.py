"""Hitachi drives, and identical ones of Omron and Watt Drive, over the ASCII protocol."""

from __future__ import annotations

from drivecomm.profiles import register_protocol
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_hitachi.dialect import HitachiDialect, HitachiOptions
from drivecomm_hitachi.telegrams import ADDRESSES, CODEC

protocol = register_protocol(
    dialect=HitachiDialect,
    codec=lambda _options: CODEC,
    options=HitachiOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=4800, bytesize=7, parity="N", stopbits=1),
        timing=Timing(reply_timeout_s=0.3, gap_s=0.05, turnaround_s=0.005, broadcast_pause_s=0.1, late_s=1.2),
    ),
    facts_source=(
        "2400 to 19200 baud, 7 or 8 bits, 10 to 1000 ms to answer (C078): SJ300 manual NB613X, p. B-2; 4800 baud 7N1, "
        "as drives are delivered by what we know, is on no page that we have; 300 ms for a C078 of up to 200 ms, late "
        "replies up to the longest C078; the gap, the turnaround and the pause after a broadcast are our defaults"
    ),
    name="hitachi",
    title="Hitachi ASCII",
    package="drivecomm_hitachi",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="sj300",
    line_errors={"error": frozenset(f"{code:02d}" for code in range(1, 9))},
    parameter_examples=("A001", "03-1", "04-B", "05-1-1"),
    same_commands=True,
)
