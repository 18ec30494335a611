"""Plug-in of the Acme line protocol for drivecomm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.protocol import Intent, LineFacts, LineSettings, Protocol, Timing
from drivecomm_acme.exchanges import AcmeOperations
from drivecomm_acme.options import AcmeOptions
from drivecomm_acme.telegrams import (
    ADDRESSES,
    ALL_DRIVES,
    AcmeCodec,
    Poll,
    Preset,
    Query,
    message_from,
    mismatch,
    titled_forms,
)
from drivecomm_acme.virtual import VirtualAcmeDrive

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message, Model, VirtualDrive


def _codec(_options: Any) -> AcmeCodec:
    return AcmeCodec()


def _virtual(address: int, options: AcmeOptions, model: Model) -> VirtualDrive:
    return VirtualAcmeDrive(address, options, model)


def _blind_spots(_data: bytes, _direction: Direction) -> frozenset[int]:
    """Return no blind spots: each single wrong bit changes the sum, or one of the fixed characters."""
    return frozenset()


def _intent(request: Message) -> Intent:
    if isinstance(request, Query | Poll):
        return Intent(access="read")
    return Intent(access="write") if isinstance(request, Preset) else Intent(commands=True)


protocol = Protocol(
    name="acme",
    title="Acme A10 line protocol",
    package="drivecomm_acme",
    facts=LineFacts(
        settings=LineSettings(baudrate=19200, bytesize=8, parity="N"),
        timing=Timing(reply_timeout_s=0.15, gap_s=0.02, turnaround_s=0.002, broadcast_pause_s=0.03),
    ),
    facts_source="19200 8N1, 150 ms, 2 ms, 30 ms: A10 line manual, section 1; the gap is a default of this package",
    addresses=ADDRESSES,
    scan_addresses=ADDRESSES,
    default_model="a10",
    broadcast_address=ALL_DRIVES,
    options=AcmeOptions,
    codec=_codec,
    message=message_from,
    mismatch=mismatch,
    operations=AcmeOperations,
    virtual=_virtual,
    blind_spots=_blind_spots,
    forms=titled_forms,
    parameter_examples=("001", "100"),
    intent=_intent,
    parameter_keys=frozenset(),
)
