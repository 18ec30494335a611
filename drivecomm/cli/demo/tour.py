"""Command `demo`: the stops of the tour, their order and a summary. An error fails its step and the tour continues."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from drivecomm.cli.demo.served import served_plant
from drivecomm.cli.demo.sites import case_for, real_site, virtual_sites
from drivecomm.cli.demo.steps import Tour
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, sentence
from drivecomm.errors import DriveCommError, TelegramError, UsageError
from drivecomm.protocol import DriveState, Stop, decode, encode, fields_of, installed
from drivecomm.testing import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import Drive, Found
    from drivecomm.cli.demo.sites import Site
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import Message
    from drivecomm.testing import Vector


_FAULT_LOCK_S = 16.0


def scan(tour: Tour, site: Site) -> list[Found]:
    """Find the drives of a line; on a virtual one, check that exactly its drives are found."""
    tour.heading(f"Scan of {site.title}")
    found: list[Found] = []
    with tour.step(f"scan {site.title.partition(':')[0]}") as tell:
        for one in site.bus.scan(addresses=range(1, 32)):
            found.append(one)
            told = ", ".join(f"{name} {value}" for name, value in one.identity.items()) or "answers"
            tour.console.print(f"  {one.name:<14} {textwrap.shorten(told, 92)}", markup=False)
        names = {one.name for one in found}
        missing = sorted(set(site.virtual) - names)
        surplus = sorted(names - set(site.virtual)) if site.virtual else []
        if missing or surplus:
            raise AssertionError(f"not found: {missing}, unexpected: {surplus}")
        tell(f"{len(found)} drives")
    return found


def values(tour: Tour, drive: Drive, protocol: str) -> None:
    """Read the values that a plant engineer needs first."""
    case = case_for(protocol, installed[protocol].parameter_examples)
    with tour.step(f"read {drive.name}") as tell:
        for place, parameter in enumerate(case.parameters):
            reading = drive.read(parameter)
            what = f"{reading.parameter} {reading.name.replace('_', ' ')}".rstrip()
            tour.console.print(f"  {'' if place else drive.name:<14} {what:<30} {reading!s:>12}")
        tell(f"{len(case.parameters)} parameters")


def motion(tour: Tour, site: Site, drive: Drive, protocol: str) -> None:
    """Start the drive, show the ramp, reverse, and stop."""
    case = case_for(protocol, ())
    can = drive.capabilities
    with tour.step(f"start, ramp, reverse, stop {drive.name}") as tell:
        drive.set_reference(**case.reference)
        drive.start()
        forwards = _ramp(site, drive, case.frequency)
        if can.reverse:
            drive.stop()
            site.let_pass(6.0)
            drive.start(reverse=True)
        else:
            drive.set_reference(**case.backwards)
        backwards = _ramp(site, drive, case.frequency)
        status = drive.status()
        drive.stop(Stop.RAMP)
        site.let_pass(8.0)
        stopped = drive.status()
        tour.console.print(f"  {drive.name:<14} forwards {forwards:<36} backwards {backwards}")
        if not status.running or stopped.running:
            raise AssertionError(f"running {status.running} after the start, {stopped.running} after the stop")
        tell(f"forwards {forwards}, backwards {backwards}, stopped")


def _ramp(site: Site, drive: Drive, frequency: str) -> str:
    readings = []
    for _ in range(4):
        site.let_pass(1.5)
        readings.append(drive.read(frequency))
    return " > ".join(str(reading.value) for reading in readings) + f" {readings[-1].unit}".rstrip()


def fault(tour: Tour, site: Site, drive: Drive, protocol: str) -> None:
    """Trip a virtual drive, show the fault, and reset it."""
    case = case_for(protocol, ())
    with tour.step(f"fault and reset {drive.name}") as tell:
        site.virtual[drive.name].trip(case.fault, site.now())
        tripped = drive.status()
        site.let_pass(_FAULT_LOCK_S)
        drive.reset()
        cleared = drive.status()
        code = f" code {tripped.fault_code}" if tripped.fault_code else ""
        text = f" {tripped.fault_text}" if tripped.fault_text else ""
        after = cleared.state.value
        if cleared.state is DriveState.NOT_READY:
            after = "not ready, because nothing has enabled it since"
        tour.console.print(
            f"  {drive.name:<14} word 0x{tripped.word:04X}: fault{code}{text}, after the reset 0x{cleared.word:04X}: "
            f"{after}",
            markup=False,
        )
        if not tripped.fault or cleared.fault:
            raise AssertionError(f"fault {tripped.fault} after the trip, {cleared.fault} after the reset")
        tell(f"tripped{code}, reset, {cleared.state.value}")


def refusals(tour: Tour, drive: Drive) -> None:
    """Show that each invalid request is refused with one sentence."""
    attempts: list[tuple[str, Callable[[], object]]] = [
        ("an unknown parameter", lambda: drive.read("not a parameter")),
        ("a value that does not fit", lambda: drive.write("481", 10**9)),
        ("a brake that it does not have", lambda: drive.stop(Stop.DC_BRAKE)),
    ]
    for what, attempt in attempts:
        with tour.step(f"refuse {what}") as tell:
            try:
                attempt()
            except DriveCommError as error:
                tour.console.print(f"  {what}: {escape(sentence(error))}")
                tell("refused in one sentence")
            else:
                raise AssertionError(f"{what} was not refused")


def one_exchange(tour: Tour, site: Site, drive: Drive, protocol: str, parameter: str) -> None:
    """Show the telegrams of one read, byte by byte."""
    tour.heading(f"One exchange in full: {drive.name} read {parameter}")
    with tour.step(f"telegrams of one read of {drive.name}") as tell:
        start = len(site.heard)
        drive.read(parameter)
        telegrams = [(event, event.message) for event in site.heard[start:] if event.message is not None]
        for event, message in telegrams:
            arrow = "master to drive" if event.what == "sent" else "drive to master"
            tour.console.print(f"[bold]{event.time:.4f} s  {arrow}: {message.kind}[/bold]")
            tour.console.print(drawn(protocol, event.data, message))
            tour.console.print()
        if len(telegrams) < 2:
            raise AssertionError("no request and reply in the trace")
        tell(f"{len(telegrams)} telegrams")


def printed_telegrams(tour: Tour, protocol: str, vectors: list[Vector]) -> None:
    """Decode and rebuild each telegram that a manual prints byte by byte, and show the first one."""
    with tour.step(f"telegrams printed in {protocol} manuals") as tell:
        wrong = [vector.id for vector in vectors if not _is_as_printed(protocol, vector)]
        first, more = vectors[0], f", and {len(vectors) - 1} more" if len(vectors) > 1 else ""
        telegram = decode(protocol, first.data, direction=first.direction, **first.options)
        fields = ", ".join(f"{name} {value}" for name, value in telegram.fields.items())
        tour.console.print(f"  {textwrap.shorten(first.source, 90)}{more}", markup=False, style="dim")
        tour.console.print(f"    {first.data.hex(' ').upper()}", markup=False)
        tour.console.print(f"    {textwrap.shorten(fields, 104)}", markup=False)
        if wrong:
            raise AssertionError(f"differs from the manual: {', '.join(wrong)}")
        tell(f"{len(vectors)} telegrams, decoded and rebuilt")


def _is_as_printed(protocol: str, vector: Vector) -> bool:
    telegram = decode(protocol, vector.data, direction=vector.direction, **vector.options)
    built = encode(protocol, vector.fields, direction=vector.direction, **vector.options)
    decoded = all(telegram.fields.get(name) == value for name, value in vector.fields.items())
    return decoded and (built == vector.data or not vector.canonical)


def drawn(protocol: str, data: bytes, message: Message) -> Table:
    """Return a table of a telegram's bytes, field by field."""
    table = Table(show_edge=False, pad_edge=False)
    for heading in ("bytes", "field", "value", "meaning"):
        table.add_column(heading)
    values = fields_of(message)
    for piece, name, meaning in _pieces(protocol, data, message):
        table.add_row(piece.hex(" ").upper(), name, str(values.get(name, "")), meaning)
    return table


def _pieces(protocol: str, data: bytes, message: Message) -> Iterator[tuple[bytes, str, str]]:
    """Split the bytes of a telegram by the form from which this message was decoded."""
    for form in installed[protocol].forms().values():
        if form.message is not type(message):
            continue
        try:
            form.parse(data)
        except TelegramError:
            continue
        rows = form.describe()
        rest = len(data) - sum(int(size) for _, size, _ in rows if size != "n")
        at = 0
        for name, size, meaning in rows:
            length = rest if size == "n" else int(size)
            yield data[at : at + length], name, meaning
            at += length
        return
    yield data, "", ""


_WIDTH = 110


@click.command(cls=LineCommand)
@click.option("--allow-motion", is_flag=True, help="With --port: also start motors.")
def demo(*, line: LineArguments, allow_motion: bool) -> int:
    """Tour everything on virtual lines in a few seconds, or on a real line with --port, reading only.

    Exit code 1 when a step failed.
    """
    if line.port is None:
        line.refuse("without --port the tour is on virtual lines")
        if allow_motion:
            raise UsageError("without --port no motor is real, so --allow-motion has no effect; leave it out")
    elif allow_motion:
        line.must_be_armed()
    console = Console(width=_WIDTH, quiet=line.json, highlight=False)
    tour = Tour(console)
    with virtual_sites() if line.port is None else real_site(line) as sites:
        for site in sites:
            _visit(tour, site, moving=allow_motion or bool(site.virtual))
    tour.heading("Telegrams printed in manuals")
    for plugin in installed.working():
        printed = [vector for vector in packaged_vectors(plugin).vectors if vector.printed and vector.valid]
        if printed:
            printed_telegrams(tour, plugin.name, printed)
    if line.port is None:
        served_plant(tour)
    _summary(tour, as_json=line.json)
    return 1 if tour.failed else 0


def _visit(tour: Tour, site: Site, *, moving: bool) -> None:
    found = scan(tour, site)
    drives = [
        (site.bus.drive(one.protocol, one.address, model=case_for(one.protocol, ()).model), one.protocol)
        for one in found
        if one.sound
    ]
    tour.heading("Values")
    for drive, protocol in drives:
        values(tour, drive, protocol)
    if moving:
        tour.heading("Motion: start, ramp, reverse, stop")
        for drive, protocol in drives:
            motion(tour, site, drive, protocol)
    if not site.virtual:
        return
    tour.heading("Faults: trip and reset")
    for drive, protocol in drives:
        fault(tour, site, drive, protocol)
    first = next((drive for drive, protocol in drives if protocol == "vabus"), None)
    if first is not None and not any("telegrams of one" in title for title, _, _ in tour.steps):
        one_exchange(tour, site, first, "vabus", parameter="481")
        tour.heading("Refusals")
        refusals(tour, first)


def _summary(tour: Tour, *, as_json: bool) -> None:
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
