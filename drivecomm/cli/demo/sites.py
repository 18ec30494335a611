"""Lines of the tour, virtual ones or the real one at --port, and the actions for each drive."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.bus import open_bus
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.bus import BlockingLine
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.link import TraceEvent
    from drivecomm.protocol import VirtualDrive


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """One line of the tour.

    let_pass: advances the time of the line by some seconds. now: returns its time. virtual: its virtual drives by name.
    heard: all trace events of the line.
    """

    title: str
    bus: BlockingLine
    let_pass: Callable[[float], None]
    now: Callable[[], float]
    virtual: dict[str, VirtualDrive] = field(default_factory=dict)
    heard: list[TraceEvent] = field(default_factory=list)


@contextmanager
def virtual_sites() -> Iterator[list[Site]]:
    """Yield two lines with six drives of all four protocols: one mixed, one whose adapter echoes."""
    mixed = [("vabus", 1), ("danfoss-fc", 3), ("vlt3500", 5), ("fuji", 7)]
    echoing = [("danfoss-fc", 12), ("vabus", 9)]
    with (
        _virtual_site("line A: 19200 7E1, 9600 8E1 and 9600 8N1 on one pair of wires", mixed, echo=False) as first,
        _virtual_site("line B: a two-wire adapter that echoes", echoing, echo=True) as second,
    ):
        yield [first, second]


@contextmanager
def _virtual_site(title: str, places: list[tuple[str, int]], *, echo: bool) -> Iterator[Site]:
    drives = {f"{protocol}:{address}": virtual_drive(protocol, address) for protocol, address in places}
    line = VirtualLine(drives.values(), echo=echo)
    heard: list[TraceEvent] = []
    with open_bus(line.port, echo=echo, trace=heard.append) as bus:
        yield Site(title=title, bus=bus, let_pass=line.advance, now=lambda: line.time, virtual=drives, heard=heard)


@contextmanager
def real_site(line: LineArguments) -> Iterator[list[Site]]:
    """Yield the real line at --port."""
    heard: list[TraceEvent] = []
    with line.bus(heard.append) as bus:
        yield [Site(title=f"line {line.port}", bus=bus, let_pass=time.sleep, now=time.monotonic, heard=heard)]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveActions:
    """Values to read from a drive, and the way to move it.

    model: model for names and units, None for bare values. parameters: parameters to read. frequency: parameter with
    the signed output frequency or speed. reference, backwards: references for running, in percent or hertz; backwards
    is for drives that reverse by a negative reference. fault: fault code with which a virtual drive trips.
    """

    model: str | None = None
    parameters: tuple[str, ...]
    frequency: str = ""
    reference: Mapping[str, int] = field(default_factory=lambda: {"percent": 60})
    backwards: Mapping[str, int] = field(default_factory=lambda: {"percent": -40})
    fault: int = 1


_CASES = {
    "vabus": DriveActions(
        model="agile",
        parameters=("stator_frequency", "rms_current", "481", "520[2]"),
        frequency="210",
        reference={"hz": 30},
        backwards={"hz": -20},
        fault=3,
    ),
    "modbus": DriveActions(
        model="danfoss-fc", parameters=("16130", "16140", "16300", "3410"), frequency="16170", fault=14
    ),
    "danfoss-fc": DriveActions(
        model="fc300", parameters=("16-13", "16-14", "16-30", "3-41"), frequency="16-17", fault=14
    ),
    "vlt3500": DriveActions(
        model="vlt3500", parameters=("502[1]", "502[9]", "215", "516"), frequency="502[1]", fault=11
    ),
    "fuji": DriveActions(
        model="frenic",
        parameters=("M09", "M11", "M21", "F07"),
        frequency="M09",
        reference={"hz": 30},
        backwards={"hz": 20},
    ),
}


def case_for(protocol: str, examples: tuple[str, ...]) -> DriveActions:
    """Return the actions for a drive; for a third-party protocol, the reads of its own examples."""
    return _CASES.get(protocol, DriveActions(parameters=examples))
