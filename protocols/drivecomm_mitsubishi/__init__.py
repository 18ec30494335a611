"""Mitsubishi and Shihlin drives over the computer link, for drivecomm."""

from drivecomm.profiles import register_protocol
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_mitsubishi.dialect import MitsubishiDialect, VirtualMitsubishiDrive
from drivecomm_mitsubishi.telegrams import STATIONS, MitsubishiOptions, codec_for

_SETTINGS = LineSettings(baudrate=19200, bytesize=8, parity="E", stopbits=2)
_CODEC = codec_for(MitsubishiOptions())

protocol = register_protocol(
    dialect=MitsubishiDialect,
    codec=codec_for,
    options=MitsubishiOptions,
    facts=LineFacts(
        settings=_SETTINGS,
        timing=Timing(
            reply_timeout_s=0.2, gap_s=0.05, turnaround_s=0.01, broadcast_pause_s=0, least_turnaround_s=0.01, attempts=2
        ),
    ),
    facts_source=(
        "8E2: MelInverter of mbed.com, 19200 baud from memory; 10 ms before one: FR-D700 manual p. 189; 200 ms as "
        "FREQROL waits; 2 attempts since damaged requests trip a drive (Pr. 121); the rest are defaults of drivecomm"
    ),
    line_sources={"least_turnaround_s": "FR-D700 manual p. 189"},
    name="mitsubishi",
    title="Mitsubishi FREQROL and Shihlin (computer link)",
    package="drivecomm_mitsubishi",
    addresses=STATIONS,
    scan_addresses=STATIONS,
    default_model="fr700",
    forms=lambda: {**codec_for(MitsubishiOptions(dialect="shihlin")).forms, **_CODEC.forms},
    message=_CODEC.message,
    blind_spots=lambda data, direction: _CODEC.blind_spots(data.rstrip(b"\r\n"), direction),
    virtual=lambda at, own, model: VirtualMitsubishiDrive(MitsubishiDialect(at, own, model), codec_for(own), _SETTINGS),
    parameter_examples=("H6F", "H74.low", "7"),
    parameter_keys=frozenset({"page", "code"}),
    line_errors={"error_code": frozenset(range(6))},
    wrong_settings="Mitsubishi drives trip by more damaged requests than Pr. 121 allows; let their motors stand",
)  # fmt: skip
