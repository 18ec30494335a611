"""Processor time of telegrams and of reads on a virtual line."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING

from conversation import READS
from report import Section

import drivecomm
from drivecomm.testing import packaged_vectors
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from equipment import Equipment

_EXCHANGES = 1000
_TELEGRAMS = 3000


def measure(equipment: Equipment) -> list[Section]:
    """Measure the telegrams that the manuals print, and a read with its virtual drive."""
    section = Section(
        title="Telegrams",
        about=(
            "Processor microseconds, mean over the protocol's own test vectors; a read on a virtual line includes the "
            "line and the drive."
        ),
        head=("protocol", "decode", "encode", "read on a virtual line", "exchanges/s"),
    )
    for protocol in READS:
        repetitions = range(equipment.extent.repetitions)
        decoding, encoding = (
            median(column) for column in zip(*(_codec_us(protocol) for _ in repetitions), strict=True)
        )
        exchange = median(_exchange_us(protocol) for _ in repetitions)
        section.rows.append(
            (protocol, f"{decoding:.1f}", f"{encoding:.1f}", f"{exchange:.0f}", f"{1e6 / exchange:.0f}")
        )
    return [section]


def _exchange_us(protocol: str) -> float:
    line = VirtualLine([virtual_drive(protocol, 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1)
        drive.read(READS[protocol])
        began = time.process_time()
        for _ in range(_EXCHANGES):
            drive.read(READS[protocol])
        return (time.process_time() - began) / _EXCHANGES * 1e6


def _codec_us(protocol: str) -> tuple[float, float]:
    plugin = drivecomm.protocols()[protocol]
    codec = plugin.codec(plugin.options())
    vectors = [one for one in packaged_vectors(plugin).vectors if one.valid and one.canonical and not one.options]
    messages = [codec.decode(one.data, one.direction) for one in vectors]
    rounds = max(1, _TELEGRAMS // len(vectors))
    began = time.process_time()
    for _ in range(rounds):
        for one in vectors:
            codec.decode(one.data, one.direction)
    decoded = time.process_time()
    for _ in range(rounds):
        for message in messages:
            codec.encode(message)
    count = rounds * len(vectors) / 1e6
    return (decoded - began) / count, (time.process_time() - decoded) / count
