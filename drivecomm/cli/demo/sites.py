"""The lines of the tour: virtual ones with virtual drives, or the real one behind --port."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.bus import open_bus
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from drivecomm.bus import Bus
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.link import TraceEvent
    from drivecomm.protocol import VirtualDrive


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """One line of the tour.

    let_pass: lets seconds pass on it. now: its time. virtual: its virtual drives by name. heard: everything that
    happened on it, as the trace tells.
    """

    title: str
    bus: Bus
    let_pass: Callable[[float], None]
    now: Callable[[], float]
    virtual: dict[str, VirtualDrive] = field(default_factory=dict)
    heard: list[TraceEvent] = field(default_factory=list)


@contextmanager
def virtual_sites() -> Iterator[list[Site]]:
    """Yield two lines with six drives of all four protocols: one mixed, one whose adapter echoes."""
    mixed = {
        "vabus:1": virtual_drive("vabus", 1),
        "danfoss-fc:3": virtual_drive("danfoss-fc", 3),
        "vlt3500:5": virtual_drive("vlt3500", 5),
        "fuji:7": virtual_drive("fuji", 7),
    }
    echoing = {"danfoss-fc:12": virtual_drive("danfoss-fc", 12), "vabus:9": virtual_drive("vabus", 9)}
    with (
        _virtual_site("line A: 19200 7E1, 9600 8E1 and 9600 8N1 on one pair of wires", mixed, echo=False) as first,
        _virtual_site("line B: a two-wire adapter that echoes", echoing, echo=True) as second,
    ):
        yield [first, second]


@contextmanager
def _virtual_site(title: str, drives: dict[str, VirtualDrive], *, echo: bool) -> Iterator[Site]:
    line = VirtualLine(drives.values(), echo=echo)
    heard: list[TraceEvent] = []
    with open_bus(line.port, echo=echo, trace=heard.append) as bus:
        yield Site(title=title, bus=bus, let_pass=line.advance, now=lambda: line.time, virtual=drives, heard=heard)


@contextmanager
def real_site(line: LineOptions) -> Iterator[list[Site]]:
    """Yield the real line behind --port."""
    heard: list[TraceEvent] = []
    with line.bus(heard.append) as bus:
        yield [Site(title=f"line {line.port}", bus=bus, let_pass=time.sleep, now=time.monotonic, heard=heard)]
