"""LS (LSIS, LG) drives over LS bus, also named LS INV 485, for drivecomm."""

from drivecomm.profiles import register_protocol
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_ls_bus.dialect import LsBusDialect, LsBusOptions, VirtualLsBusDrive
from drivecomm_ls_bus.telegrams import CODEC, STATIONS

_SETTINGS = LineSettings(baudrate=9600, bytesize=8, parity="N", stopbits=1)

protocol = register_protocol(
    dialect=LsBusDialect,
    codec=lambda _options: CODEC,
    options=LsBusOptions,
    facts=LineFacts(
        settings=_SETTINGS,
        timing=Timing(reply_timeout_s=0.2, gap_s=0.05, turnaround_s=0.005, broadcast_pause_s=0.1, late_s=1.2),
    ),
    facts_source=(
        "8N1, 8N2, 8E1 or 8O1, up to 115200 baud, and a delay before the reply that is set at the drive: LSLV-S100 "
        "manual p. 231; 9600 8N1 as delivered is on no page that we have, and all times are our defaults"
    ),
    name="ls-bus",
    title="LS bus (LS INV 485)",
    package="drivecomm_ls_bus",
    addresses=STATIONS,
    scan_addresses=range(1, 32),
    default_model="ig5a",
    virtual=lambda at, own, model: VirtualLsBusDrive(LsBusDialect(at, own, model), CODEC, _SETTINGS),
    parameter_keys=frozenset(),
    line_errors={"error": frozenset({"FE"})},
    parameter_examples=("0x0000", "0x0009"),
)
