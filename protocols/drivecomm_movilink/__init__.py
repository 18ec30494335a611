"""MOVILINK over RS-485, the serial protocol of SEW-EURODRIVE drives, for drivecomm."""

from drivecomm import profiles
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_movilink.drive import MovilinkDialect, MovilinkOperations, MovilinkOptions, VirtualMovilinkDrive
from drivecomm_movilink.telegrams import ADDRESSES, TELEGRAMS

protocol = profiles.register_protocol(
    dialect=MovilinkDialect,
    codec=lambda _options: TELEGRAMS,
    options=MovilinkOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=8, parity="E"),
        timing=Timing(
            reply_timeout_s=0.1, gap_s=0.05, turnaround_s=0.004, broadcast_pause_s=0.025, least_turnaround_s=0.00344
        ),
    ),
    facts_source=(
        "9600 8E1, 3.44 ms of silence before a telegram: MOVIDRIVE MDX60B/61B communication manual p. 18, 20; 100 ms "
        "to answer, 25 ms after a broadcast: MOVIMOT (web manual 617493131, MM03C p. 123); the rest are defaults"
    ),
    line_sources={
        **dict.fromkeys(
            ("baudrate", "bytesize", "parity", "least_turnaround_s", "silence_characters"),
            "MOVIDRIVE MDX60B/61B communication manual p. 18, 20",
        ),
        **dict.fromkeys(("reply_timeout_s", "broadcast_pause_s"), "MOVIMOT web manual 617493131, MM03C p. 123"),
    },
    name="movilink",
    title="SEW MOVILINK",
    package="drivecomm_movilink",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="movidrive-b",
    message=TELEGRAMS.message,
    operations=MovilinkOperations,
    memory=profiles.CommandMemory,
    virtual=VirtualMovilinkDrive,
    forms=lambda: TELEGRAMS.forms,
    control_profiles=lambda: (profiles.control_profile("movilink"),),
    parameter_examples=("8300", "8470", "8470.1"),
    same_commands=True,
    silence_characters=3,
)
