"""The plug-in for older Huanyang drives."""

from __future__ import annotations

from drivecomm.profiles import CONTROL_KEYS, RegisterCommandMemory
from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, later
from drivecomm_huanyang.dialect import HuanyangDialect, address_space
from drivecomm_huanyang.exchanges import HuanyangOperations
from drivecomm_huanyang.options import HuanyangOptions
from drivecomm_huanyang.telegrams import (
    ADDRESSES,
    BROADCAST,
    HuanyangCodec,
    intent,
    message_from,
    mismatch,
    titled_forms,
)

protocol = Protocol(
    name="huanyang",
    title="Huanyang (older drives)",
    package="drivecomm_huanyang",
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="N", stopbits=1),
        timing=Timing(
            reply_timeout_s=0.5, gap_s=0.050, turnaround_s=0.050, broadcast_pause_s=0.1, late_s=1.0, attempts=3
        ),
    ),
    facts_source=(
        "9600 baud: factory setting of PD164, HY Series Inverter, User Manual of 27 June 2010, p. 59; 8N1 as programs "
        "in use have it (PD165 = 3; from the factory it is 0, ASCII, which is not covered); 50 ms of quiet between "
        "telegrams: p. 63; 500 ms to answer: what LinuxCNC hy_vfd waits; the gap, the pause after a broadcast, late "
        "replies and attempts are defaults of drivecomm"
    ),
    line_sources={
        "baudrate": "HY Series Inverter, User Manual of 27 June 2010, p. 59",
        "turnaround_s": "HY Series Inverter, User Manual of 27 June 2010, p. 63",
    },
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="hy",
    broadcast_address=BROADCAST,
    options=HuanyangOptions,
    codec=lambda _options: HuanyangCodec(),
    message=message_from,
    mismatch=mismatch,
    operations=HuanyangOperations,
    memory=RegisterCommandMemory,
    virtual=later("drivecomm_huanyang.virtual:VirtualHuanyangDrive"),
    forms=titled_forms,
    parameter_examples=("PD005", "CFG1"),
    intent=intent,
    parameter_keys=frozenset({"bytes"}),
    control_keys=CONTROL_KEYS,
    same_commands=True,
    ambiguous_with={
        # Only in this direction: a telegram to a Huanyang drive is at most a read for a Modbus drive.
        "modbus": (
            "a read of discrete inputs from 0300H on writes a parameter of the Huanyang drive of the same number; no "
            "read of holding registers is control data with the LEN of its manual, but no page says how a drive treats "
            "another LEN: one that ignores it takes the low byte of the register for its command: an odd one is a "
            "start, and others may jog it"
        )
    },
    address_space=address_space,
    refusals=lambda *_: HuanyangDialect.refusals,
)
