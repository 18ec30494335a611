"""Accuracy of a poll plan's forecast on an emulated line: 40 parameters of 8 drives of four protocols."""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING, Any

from lines import EmulatedLine
from report import Figure, Section

import drivecomm
from drivecomm.line import PollItem, PollPlan
from drivecomm.models import load_model
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualLine, forecast, virtual_drive

if TYPE_CHECKING:
    from equipment import Equipment

_DELAY_S = 0.005
_PARAMETERS = 5
_BITS = 10.0
_WITHIN = 0.03
_ADDRESSES = {"vabus": (1, 2), "danfoss-fc": (3, 4), "vlt3500": (5, 6), "fuji": (7, 8)}


def measure(equipment: Equipment) -> list[Section]:
    """Measure at two baud rates."""
    section = Section(
        title="Forecast",
        about=(
            "40 parameters on 8 drives of four protocols, all at 8N1 (an emulated line has one character length), read "
            "round after round on an emulated line whose drives answer after 5 ms; the median round against "
            "`drivecomm forecast` of the same plan."
        ),
        head=("baud", "forecast ms", "measured ms", "measured / forecast"),
    )
    for baudrate in (9600, 38400):
        plan = _plan(baudrate)
        foreseen = forecast(plan).cycle_s
        line = EmulatedLine(
            bits=_BITS, baudrate=baudrate, delay_s=(_DELAY_S, _DELAY_S), answers=_spoken(plan), whole=False
        )
        run = equipment.instrument.measure([line], lambda paths, plan=plan: _round_s(plan, paths[0]))
        ratio = run.result / foreseen
        section.rows.append((str(baudrate), f"{foreseen * 1000:.1f}", f"{run.result * 1000:.1f}", f"{ratio:.4f}"))
        section.figures.append(
            Figure(
                name=f"forecast against measured, off by, {baudrate}",
                value=abs(ratio - 1),
                promise=_WITHIN,
                floor=_WITHIN,
                better="less",
                disturbed=run.disturbed,
            )
        )
    return [section]


def _plan(baudrate: int) -> PollPlan:
    reads = []
    for protocol, addresses in _ADDRESSES.items():
        plugin = drivecomm.protocols()[protocol]
        for address in addresses:
            options = {"baudrate": baudrate, "bytesize": 8, "parity": "N", "stopbits": 1, "model": plugin.default_model}
            drive = DriveConfig(protocol=protocol, address=address, options=options, reply_delay_s=_DELAY_S)
            reads += [PollItem(drive=drive, parameter=parameter) for parameter in _readable(protocol, address)]
    return PollPlan(reads=tuple(reads))


def _readable(protocol: str, address: int) -> list[str]:
    """Return parameters that the default model's virtual drive can read."""
    plugin = drivecomm.protocols()[protocol]
    line = VirtualLine([virtual_drive(protocol, address)])
    found: list[str] = []
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, address, model=plugin.default_model)
        for parameter in load_model(plugin.package, protocol, plugin.default_model).parameters:
            try:
                drive.read(parameter)
            except drivecomm.DriveCommError:
                continue
            found.append(parameter)
            if len(found) == _PARAMETERS:
                break
    return found


def _spoken(plan: PollPlan) -> dict[bytes, bytes]:
    """Return the request and reply of each read on a virtual line; an empty reply for a telegram without one."""
    spoken: dict[bytes, bytes] = {}
    asked = b""

    def note(event: drivecomm.TraceEvent) -> None:
        nonlocal asked
        if event.what == "sent":
            asked = event.data
            spoken.setdefault(asked, b"")
        elif event.what == "received":
            spoken[asked] = event.data

    drives = [
        virtual_drive(drive.protocol, drive.address, **{**drive.options, "model": drive.options["model"]})
        for drive in plan.drives
    ]
    with drivecomm.open_bus(VirtualLine(drives).port, trace=note) as bus:
        _ask(plan, bus)
    return spoken


def _ask(plan: PollPlan, bus: Any) -> None:
    drives = {drive: bus.drive(drive.protocol, drive.address, **drive.options) for drive in plan.drives}
    for read in plan.reads:
        drives[read.drive].read(read.parameter)


def _round_s(plan: PollPlan, path: str) -> float:
    with drivecomm.open_bus(path) as bus:
        drives = {drive: bus.drive(drive.protocol, drive.address, **drive.options) for drive in plan.drives}
        rounds = []
        for _ in range(4):
            began = time.perf_counter()
            for read in plan.reads:
                drives[read.drive].read(read.parameter)
            rounds.append(time.perf_counter() - began)
        return statistics.median(rounds[1:])
