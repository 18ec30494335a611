"""Toshiba drives over Toshiba's own inverter protocol, for drivecomm."""

from drivecomm.profiles import CONTROL_KEYS, register_protocol
from drivecomm.protocol import LineFacts, Timing
from drivecomm_toshiba.dialect import SETTINGS, ToshibaDialect, VirtualToshibaDrive
from drivecomm_toshiba.telegrams import ADDRESSES, ToshibaOptions, codec_for

protocol = register_protocol(
    dialect=ToshibaDialect,
    codec=codec_for,
    options=ToshibaOptions,
    facts=LineFacts(
        settings=SETTINGS,
        timing=Timing(reply_timeout_s=0.1, gap_s=0.05, turnaround_s=0.005, broadcast_pause_s=0.1, late_s=0.5),
    ),
    facts_source=(
        "9600 8E1 of a VF-S11: vfs11.adoc of LinuxCNC; 19200 8E1 of a VF-S15: manual E6581913 p. 4; 3.5 characters of "
        "silence around a telegram: p. 7; the reply time, the gap, the pauses and late replies are our defaults"
    ),
    name="toshiba",
    title="Toshiba inverter protocol",
    package="drivecomm_toshiba",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="vf-s11",
    virtual=VirtualToshibaDrive,
    blind_spots=lambda data, direction: codec_for(ToshibaOptions(sum=b"&" in data)).blind_spots(data, direction),
    control_keys=CONTROL_KEYS | {"identity"},
    line_errors={"error_code": frozenset({4})},
    parameter_examples=("FD00", "0012"),
)
