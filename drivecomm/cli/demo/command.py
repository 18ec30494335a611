"""The demo command: the order of the tour and its summary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from drivecomm.cli.demo import tour as stops
from drivecomm.cli.demo.sites import case_for, real_site, virtual_sites
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit
from drivecomm.errors import UsageError
from drivecomm.protocol import installed
from drivecomm.testing import packaged_vectors

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from drivecomm.cli.demo.sites import Site

_WIDTH = 110


def demo(
    line: LineOptions,
    allow_motion: Annotated[bool, typer.Option("--allow-motion", help="With --port: also start motors.")] = False,
) -> int:
    """Tour everything on virtual lines in a few seconds, or on a real line with --port, reading only.

    Exit code 1 when a step failed.
    """
    if line.port is None:
        line.refuse("without --port the tour is on virtual lines")
        if allow_motion:
            raise UsageError("without --port no motor is real, so --allow-motion has no effect; leave it out")
    elif allow_motion:
        line.must_be_armed()
    console = Console(width=_WIDTH, quiet=line.json)
    tour = stops.Tour(console)
    sites: AbstractContextManager[list[Site]] = virtual_sites() if line.port is None else real_site(line)
    with sites as opened:
        for site in opened:
            _visit(tour, site, moving=allow_motion or bool(site.virtual))
    tour.heading("Telegrams printed in manuals")
    for plugin in installed.working():
        printed = [vector for vector in packaged_vectors(plugin).vectors if vector.printed and vector.valid]
        if printed:
            stops.printed_telegrams(tour, plugin.name, printed)
    _summary(tour, as_json=line.json)
    return 1 if tour.failed else 0


def _visit(tour: stops.Tour, site: Site, *, moving: bool) -> None:
    found = stops.scan(tour, site)
    drives = [
        (site.bus.drive(one.protocol, one.address, model=case_for(one.protocol, ()).model), one.protocol)
        for one in found
        if one.sound
    ]
    tour.heading("Values")
    for drive, protocol in drives:
        stops.values(tour, drive, protocol)
    if moving:
        tour.heading("Motion: start, ramp, reverse, stop")
        for drive, protocol in drives:
            stops.motion(tour, site, drive, protocol)
    if not site.virtual:
        return
    tour.heading("Faults: trip and reset")
    for drive, protocol in drives:
        stops.fault(tour, site, drive, protocol)
    first = next((drive for drive, protocol in drives if protocol == "vabus"), None)
    if first is not None and not any("telegrams of one" in title for title, _, _ in tour.steps):
        stops.one_exchange(tour, site, first, "vabus", parameter="481")
        tour.heading("Refusals")
        stops.refusals(tour, first)


def _summary(tour: stops.Tour, *, as_json: bool) -> None:
    table = Table(title="Summary", title_justify="left", title_style="bold cyan", show_edge=False, pad_edge=False)
    for heading in ("step", "result", "seen"):
        table.add_column(heading)
    for title, worked, seen in tour.steps:
        table.add_row(title, "[green]ok[/green]" if worked else "[red]failed[/red]", seen)
        if as_json:
            emit(step=title, ok=worked, seen=seen)
    tour.console.print()
    tour.console.print(table)
    tour.console.print(f"\n{len(tour.steps) - tour.failed} of {len(tour.steps)} steps worked")
