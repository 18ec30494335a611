"""Effect of `drivecomm tune` on drives that need much less than the default pause after their replies."""

from __future__ import annotations

from dataclasses import replace
from statistics import median
from typing import TYPE_CHECKING

from clients import reading, run_reference
from conversation import record_conversation
from lines import mostly, undisturbed
from report import Figure, Section

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from clients import Ran
    from equipment import Equipment

NEEDED_S = 0.001
BAUDRATE = 115200
PROTOCOLS = ("vlt3500", "fuji")
# Pretend that the maker of the model requires no pause.
_NONE_DEMANDED = {"least_turnaround_s": 0.0}
_PROMISE, _FLOOR = 0.92, 0.85


def measure(equipment: Equipment) -> list[Section]:
    """Read with the default pause, tune, and read again."""
    section = Section(
        title="Tuned drives",
        about=(
            f"One line at {BAUDRATE} baud, a drive that answers after 2 ms and does not hear what begins sooner than "
            f"{NEEDED_S * 1000:g} ms after its reply; `drive.read` again and again, before and after `tune`. The share "
            "of what this drive allows: characters, its 2 ms, and the pause that it needs. bare wire: the same without "
            "that pause, which no master can reach. The C client keeps the needed pause and no margin."
        ),
        head=("protocol", "ideal/s", "before", "after", "C client", "before", "after", "of the bare wire", "after / C"),
    )
    for protocol in PROTOCOLS:
        _one(equipment, protocol, section)
    return [section]


def _one(equipment: Equipment, protocol: str, section: Section) -> None:
    usual = record_conversation(protocol, BAUDRATE, **_NONE_DEMANDED)
    needed = replace(usual, pause_s=NEEDED_S)
    line = needed.line()
    line = replace(line, answers={**line.answers, **_probed(protocol)}, deaf_s=NEEDED_S)
    seconds = equipment.extent.seconds
    rates: dict[str, list[float]] = {"blocking": [], "tuned": [], "C": []}
    disturbed: list[bool] = []
    for _ in range(equipment.extent.repetitions):

        def work(paths: list[str]) -> dict[str, Ran]:
            ways = {way: equipment.master.work(reading(way, usual, [path], seconds))
                    for way, path in zip(("blocking", "tuned"), paths, strict=False)}  # fmt: skip
            # The C client keeps the exact limit and would miss replies, so its drive accepts every request.
            return {**ways, "C": run_reference(equipment.programs.reference_client, needed, paths[2:], seconds)}

        run = equipment.instrument.measure([line, line, replace(line, deaf_s=0.0)], work)
        disturbed.append(run.disturbed)
        for way, ran in run.result.items():
            rates[way].append(ran.rates[0])
    before, after, of_c = (median(undisturbed(rates[way], disturbed)) for way in ("blocking", "tuned", "C"))
    cycle_s = needed.cycle_s()
    section.rows.append(
        (
            protocol,
            f"{1 / cycle_s:.1f}",
            *(f"{rate:.1f}" for rate in (before, after, of_c)),
            *(f"{rate * cycle_s:.4f}" for rate in (before, after)),
            f"{after * (cycle_s - NEEDED_S):.4f}",
            f"{after / of_c:.4f}",
        )
    )
    section.figures.append(
        Figure(
            name=f"share after tune of what a drive that needs {NEEDED_S * 1000:g} ms allows, {protocol}, {BAUDRATE}",
            value=after * cycle_s,
            promise=_PROMISE,
            floor=_FLOOR,
            disturbed=mostly(disturbed),
        )
    )


def _probed(protocol: str) -> dict[bytes, bytes]:
    """Return the telegrams of the protocol's probe."""
    events: list[drivecomm.TraceEvent] = []
    line = VirtualLine([virtual_drive(protocol, 1, baudrate=BAUDRATE)])
    with drivecomm.open_bus(line.port, baudrate=BAUDRATE, trace=events.append) as bus:
        bus.drive(protocol, 1).probe()
    (request,) = (event.data for event in events if event.what == "sent")
    (reply,) = (event.data for event in events if event.what == "received")
    return {request: reply}
