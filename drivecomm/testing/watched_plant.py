"""A virtual plant as a test sees it: its lines and drives by the names that the plant gives them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.protocol import installed
from drivecomm.testing.line_trace import LineTrace
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.testing.watched_line import ServingThread, WatchedDrive, WatchedLine
from drivecomm.virtual import PlantServer, VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.plant import Plant
    from drivecomm.protocol import VirtualDrive


class WatchedPlant:
    """Lines with virtual drives on them, and the script of what goes wrong.

    lines, drives: all of them by name. In virtual time each line has a clock of its own.
    """

    def __init__(
        self, plant: VirtualPlant, lines: Mapping[str, WatchedLine], thread: ServingThread | None = None
    ) -> None:
        self.lines = dict(lines)
        self.drives = {drive.name: drive for line in lines.values() for drive in line.drives}
        self._plant = plant
        self._thread = thread

    @property
    def plant(self) -> VirtualPlant:
        """The plant itself, to steer it and to add to its script. Raises UsageError when it is served in real time."""
        if self._thread is not None:
            raise UsageError("this plant is served in real time; make it without listen= to steer it")
        return self._plant

    def line(self, name: str) -> WatchedLine:
        """Return the line with this name. Raises UsageError."""
        if name not in self.lines:
            raise UsageError(f"there is no line {name!r} in this plant; it has {', '.join(self.lines)}")
        return self.lines[name]

    def drive(self, name: str) -> WatchedDrive:
        """Return the drive with this name. Raises UsageError."""
        if name not in self.drives:
            raise UsageError(f"there is no drive {name!r} in this plant; it has {', '.join(self.drives) or 'none'}")
        return self.drives[name]

    def close(self) -> None:
        """Stop serving; what was received can still be looked at. The end of the test does it anyway."""
        if self._thread is not None:
            self._thread.close()


def watched_plant(plant: Plant, place: Callable[[], str] | None) -> WatchedPlant:
    """Make a plant. place: gives each line a place to listen; None for virtual time. Raises UsageError, PortError."""
    if place is not None:
        plant = replace(plant, lines=tuple(replace(line, listen=place()) for line in plant.lines))
    protocols = {drive.name: installed[drive.protocol] for drive in plant.drives}
    records: defaultdict[str, Record] = defaultdict(Record)

    def watched(name: str, drive: VirtualDrive) -> VirtualDrive:
        return RecordingDrive(protocols[name], drive, records[name])

    virtual = VirtualPlant(plant, around=watched)
    traces = {name: LineTrace(line) for name, line in virtual.lines.items()}
    server = None if place is None else PlantServer(virtual)
    thread = None if server is None else ServingThread(server)
    lines = {}
    for name, line in virtual.lines.items():
        planted = [virtual.drive(drive.name) for drive in plant.on_line(name)]
        drives = [WatchedDrive(each.name, each, records[each.name], each.type.new) for each in planted]
        served = (thread, server.addresses[name]) if server is not None and thread is not None else None
        lines[name] = WatchedLine(line, drives, traces[name], served)
    return WatchedPlant(virtual, lines, thread)
