"""Check of packages that can read several parameters with one telegram."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import ReadsMany, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, raise_all

if TYPE_CHECKING:
    from drivecomm.protocol import Model, Protocol


@check("commands")
def reads_together_what_it_reads_one_by_one(plugin: Protocol, model: Model) -> None:
    """Reading parameters in blocks gives the same values as single reads, with one telegram for each block.

    Each parameter is in exactly one block, and no block is refused.
    """
    memory = () if plugin.memory is None else (plugin.memory(),)
    options = resolve_options(plugin, model, {})[1]
    operations = plugin.operations(plugin.addresses[0], options, model, *memory)
    if not isinstance(operations, ReadsMany):
        return
    parameters = [info.address for info in model.parameters.values() if "r" in info.access]
    blocks = [list(block) for block in operations.blocks(parameters)]
    places = sorted(place for block in blocks for place in block)
    expect(places == list(range(len(parameters))), "the blocks do not hold each parameter once")
    with bench(plugin, model) as on:
        alone, took = [], []
        for each in parameters:
            on.virtual.heard.clear()
            alone.append(on.drive.read(each))
            took.append(len(on.virtual.heard))
        on.virtual.heard.clear()
        together = on.drive.read_many(parameters)
        sent = len(on.virtual.heard)
    raise_all(
        [
            f"{one.parameter} is {other} together with others, and {one.raw!r} alone"
            for one, other in zip(alone, together, strict=True)
            if getattr(other, "raw", None) != one.raw or getattr(other, "parameter", "") != one.parameter
        ]
    )
    needed = sum(1 if len(block) > 1 else took[block[0]] for block in blocks)
    expect(sent <= needed, f"{len(blocks)} blocks take {sent} telegrams, so that some of them are refused")
