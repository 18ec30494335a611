"""Cost of a further drive of a model that is already loaded: milliseconds, and its own memory."""

from __future__ import annotations

import gc
import time
import tracemalloc
from typing import TYPE_CHECKING

from report import Figure, Section
from yardstick import slowness

from drivecomm import open_bus
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine

if TYPE_CHECKING:
    from equipment import Equipment

    from drivecomm import Bus
    from drivecomm.protocol import Protocol

# Milliseconds and KiB.
_PROMISES, _FLOORS = (0.2, 5.0), (0.5, 15.0)
_DRIVES = 30


def measure(_: Equipment) -> list[Section]:
    """Measure each protocol with its default model."""
    section = Section(
        title="A drive of a loaded model",
        about=f"`bus.drive(..., model=...)`: the least processor time and the mean memory of {_DRIVES} drives.",
        head=("protocol", "model", "ms", "KiB"),
    )
    costs = []
    with open_bus(VirtualLine([]).port) as bus:
        for plugin in installed.working():
            took_ms, took_kib = _least_ms(bus, plugin), _mean_kib(bus, plugin)
            costs.append((took_ms, took_kib))
            section.rows.append((plugin.name, plugin.default_model, f"{took_ms:.2f}", f"{took_kib:.1f}"))
    worst = [max(each) for each in zip(*costs, strict=True)]
    marks = zip(("ms", "KiB"), worst, _PROMISES, _FLOORS, (slowness(), 1.0), strict=True)
    for unit, value, promise, floor, slow in marks:
        name = f"{unit} for a drive of a loaded model"
        section.figures.append(Figure(name=name, value=value, promise=promise, floor=floor * slow, better="less"))
    return [section]


def _least_ms(bus: Bus, plugin: Protocol) -> float:
    taken = []
    for _ in range(_DRIVES + 1):
        began = time.process_time()
        _drive(bus, plugin, plugin.addresses[0])
        taken.append(time.process_time() - began)
    # The first drive also loads the model.
    return min(taken[1:]) * 1000


def _mean_kib(bus: Bus, plugin: Protocol) -> float:
    gc.collect()
    tracemalloc.start()
    try:
        kept = [_drive(bus, plugin, address) for address in plugin.addresses[:_DRIVES]]
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / len(kept) / 1024
    finally:
        tracemalloc.stop()


def _drive(bus: Bus, plugin: Protocol, address: int) -> object:
    return bus.drive(plugin.name, address, model=plugin.default_model)
