"""The plug-in for VABus drives."""

from __future__ import annotations

from drivecomm.protocol import LineFacts, LineSettings, Protocol, Timing, code_texts, later
from drivecomm_vabus import telegrams
from drivecomm_vabus.conversation import VabusMemory, profile
from drivecomm_vabus.exchanges import VabusOperations
from drivecomm_vabus.options import VabusOptions
from drivecomm_vabus.parameters import address_space, element_addresses
from drivecomm_vabus.telegrams import BROADCAST, NODES

protocol = Protocol(
    name="vabus",
    title="Bonfiglioli VABus",
    package="drivecomm_vabus",
    facts=LineFacts(
        settings=LineSettings(baudrate=19200, bytesize=7, parity="E"),
        timing=Timing(
            reply_timeout_s=0.5,
            gap_s=0.050,
            gap_characters=3,
            turnaround_s=0.002,
            broadcast_pause_s=0.050,
            late_s=2.0,
            attempts=3,
            least_turnaround_s=0.002,
            least_reply_timeout_s=0.5,
        ),
    ),
    facts_source=(
        "7E1 and 19200 baud: short description sections 4 and 8; 2 ms before the master speaks: Agile VABus manual "
        "p. 33; 500 ms and a later answer under load: ACT/ACU Modbus manual p. 35; three transmissions: Agile VABus "
        "manual p. 27; gap and broadcast pause are not printed anywhere, defaults of drivecomm"
    ),
    line_sources={
        **dict.fromkeys(("baudrate", "bytesize", "parity"), "VABus short description, sections 4 and 8"),
        **dict.fromkeys(("turnaround_s", "least_turnaround_s"), "Agile VABus manual p. 33"),
        "reply_timeout_s": "ACT/ACU Modbus manual p. 35",
    },
    unanswered=frozenset(("eot",)),
    addresses=NODES,
    scan_addresses=NODES,
    default_model="agile",
    broadcast_address=BROADCAST,
    options=VabusOptions,
    codec=lambda options: telegrams.telegrams(options.type, lower_case_hex=options.lower_case_hex),
    message=telegrams.telegrams().message,
    mismatch=telegrams.mismatch,
    operations=VabusOperations,
    memory=VabusMemory,
    virtual=later("drivecomm_vabus.virtual:VirtualVabusDrive"),
    blind_spots=telegrams.blind_spots,
    forms=lambda: telegrams.telegrams().forms,
    parameter_examples=("481", "520[2]", "C00"),
    intent=telegrams.intent,
    parameter_keys=frozenset({"datasets"}),
    element_addresses=element_addresses,
    references=lambda options, _: options.references,
    refusals=lambda _options, _model: code_texts(__file__, "errors.toml"),
    address_space=address_space,
    control_profiles=lambda: (profile(),),
    ambiguous_with={"weg": "a read of a WEG drive is an enquiry to the VABus drive of the same number"},
)
