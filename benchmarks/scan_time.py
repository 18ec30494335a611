"""Duration of a scan compared with the minimum; one bus, and sixteen concurrently."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

from clients import Job
from conversation import DELAY_S
from lines import EmulatedLine, MeasurementError, mostly
from report import Figure, Section

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from equipment import Equipment

_PROTOCOLS = ("vabus", "danfoss-fc")
_NAMELESS = ("danfoss-fc",)
"""Protocols whose first reply to a scan does not identify its request."""
_LIVE = (1, 11, 21)
_REPLY_TIMEOUT_S = 0.020
_MARGIN_S = 0.002
_BUSES = 16
_PROMISE = 0.97
_MOST_TIMES = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scan:
    """Telegrams of a scan, and its minimum duration. silent: number of addresses without a drive."""

    protocol: str
    baudrate: int
    line: EmulatedLine
    least_s: float
    silent: int


def measure(equipment: Equipment) -> list[Section]:
    """Measure one bus at several speeds, then sixteen concurrently."""
    section = Section(
        title="Scan",
        about=(
            "`bus.scan` over 31 addresses (VABus: 30) of which three answer after 2 ms; a reply may take 20 ms. Least "
            "on a port without a pace, such as a network's: what is silent costs its request, as long again (a gateway "
            "may hand a reply on whole), and the longest reply time; what answers costs its telegrams, its delays and "
            "pauses, identification included, and the longest reply time where its first reply does not say what it "
            "answers and is listened out. Share: of the least time plus 2 ms for each silent address."
        ),
        head=("protocol", "buses", "baud", "least ms", "ms", "share", "times one bus"),
    )
    for protocol in _PROTOCOLS:
        for baudrate in sorted({*equipment.extent.baudrates, 19200} - {38400}):
            _one(equipment, section, protocol, baudrate)
    return [section]


def _one(equipment: Equipment, section: Section, protocol: str, baudrate: int) -> None:
    scan = _learn(protocol, baudrate)
    name = f"{protocol}, {baudrate}"
    repetitions = min(equipment.extent.repetitions, 3)
    disturbed: list[bool] = []
    single = median(_seconds(equipment, scan, 1, disturbed) for _ in range(repetitions))
    share = (scan.least_s + scan.silent * _MARGIN_S) / single
    section.rows.append(
        (protocol, "1", str(baudrate), f"{scan.least_s * 1000:.0f}", f"{single * 1000:.0f}", f"{share:.3f}", "")
    )
    section.figures.append(
        Figure(
            name=f"scan share, {name}",
            value=share,
            promise=_PROMISE,
            floor=_PROMISE - 0.01,
            disturbed=mostly(disturbed),
        )
    )
    if baudrate != 19200:
        return
    disturbed.clear()
    many = median(_seconds(equipment, scan, _BUSES, disturbed) for _ in range(repetitions))
    section.rows.append(
        (protocol, str(_BUSES), str(baudrate), f"{scan.least_s * 1000:.0f}", f"{many * 1000:.0f}", "",
         f"{many / single:.2f}")
    )  # fmt: skip
    section.figures.append(
        Figure(
            name=f"{_BUSES} scans at once in times one, {name}",
            value=many / single,
            promise=_MOST_TIMES,
            floor=_MOST_TIMES,
            better="less",
            disturbed=mostly(disturbed),
        )
    )


def _seconds(equipment: Equipment, scan: _Scan, buses: int, disturbed: list[bool]) -> float:
    """Scan this many buses concurrently; return the seconds of the slowest, and record whether it was disturbed."""
    run = equipment.instrument.measure(
        [scan.line] * buses,
        lambda paths: equipment.master.work(
            Job(
                way="scan",
                paths=paths,
                baudrate=scan.baudrate,
                seconds=0.0,
                protocol=scan.protocol,
                options={"reply_timeout_s": _REPLY_TIMEOUT_S},
            )
        ),
    )
    disturbed.append(run.disturbed)
    for found, _ in run.result.lines:
        if found != len(_LIVE):
            raise MeasurementError(f"a scan for {scan.protocol} found {found} drives instead of {len(_LIVE)}")
    return max(seconds for _, seconds in run.result.lines)


def _learn(protocol: str, baudrate: int) -> _Scan:
    """Scan a virtual line, and return the recorded telegrams."""
    events: list[drivecomm.TraceEvent] = []
    plugin = drivecomm.protocols()[protocol]
    line = VirtualLine([virtual_drive(protocol, one, baudrate=baudrate) for one in _LIVE])
    with drivecomm.open_bus(line.port, baudrate=baudrate, trace=events.append, reply_timeout_s=0.1) as bus:
        facts = bus.drive(protocol, 1).facts
        list(bus.scan([protocol], _LIVE))
    spoken = [(event.what, event.data) for event in events if event.what in ("sent", "received")]
    answers: dict[bytes, bytes] = {}
    characters, replies = 0, 0
    for place, (what, data) in enumerate(spoken):
        characters += len(data)
        if what == "received":
            replies += 1
            continue
        after = spoken[place + 1] if place + 1 < len(spoken) else ("sent", b"")
        answers[data] = after[1] if after[0] == "received" else b""
    silent = sum(address in plugin.addresses for address in range(1, 32)) - len(_LIVE)
    character_s = facts.settings.character_s
    answered_s = characters * character_s + replies * (DELAY_S + facts.turnaround_s)
    if protocol in _NAMELESS:
        answered_s += len(_LIVE) * _REPLY_TIMEOUT_S
    silent_s = 2 * len(spoken[0][1]) * character_s + _REPLY_TIMEOUT_S
    return _Scan(
        protocol=protocol,
        baudrate=baudrate,
        line=EmulatedLine(
            bits=round(character_s * baudrate, 1), baudrate=baudrate, delay_s=(DELAY_S, DELAY_S), answers=answers
        ),
        least_s=answered_s + silent * silent_s,
        silent=silent,
    )
