"""Protocol package for Eurotherm and Parker SSD drives over EI Bisynch (ANSI X3.28) in ASCII."""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm.errors import UsageError
from drivecomm.profiles import register_protocol
from drivecomm.protocol import LineFacts, LineSettings, Timing
from drivecomm_ei_bisynch.dialect import EiDialect
from drivecomm_ei_bisynch.telegrams import codec_for


@dataclass(frozen=True, slots=True, kw_only=True)
class EiOptions:
    """Options of a Eurotherm or Parker SSD drive.

    lift: whether 20H is added to a check character below 20H; None, the default, adds nothing and accepts both.
    """

    lift: bool | None = None

    def __post_init__(self) -> None:
        if self.lift not in (True, False, None):
            raise UsageError(f"lift of {self.lift!r} is not true or false")


protocol = register_protocol(
    dialect=EiDialect,
    codec=lambda options: codec_for(options.lift),
    options=EiOptions,
    facts=LineFacts(
        settings=LineSettings(baudrate=9600, bytesize=7, parity="E"),
        timing=Timing(reply_timeout_s=0.25, gap_s=0.05, turnaround_s=0.01, broadcast_pause_s=0.05, late_s=0.5),
    ),
    facts_source=(
        "9600 baud, one of the rates of 590+ manual p. A-15; 7E1: 7 bits and 10 in all by p. A-13, even parity from "
        "memory; all times are defaults"
    ),
    name="ei-bisynch",
    title="Eurotherm EI Bisynch (ASCII)",
    package="drivecomm_ei_bisynch",
    addresses=range(160),
    scan_addresses=range(128),
    default_model="parker-590plus",
    parameter_keys=frozenset(),
    parameter_examples=("II", "0F"),
)
