"""A virtual plant as a test sees it: its lines, its drives and its fault script."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.protocol import installed
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.testing.watched_line import ServingThread, WatchedDrive, WatchedLine
from drivecomm.virtual import SERVED_TOLERANCE_S, PlantServer, VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.plant import FaultPlan, Plant


class WatchedPlant:
    """Lines with virtual drives on them, and the script of their faults.

    lines, drives: by name. In virtual time each line has a clock of its own.
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
        """The virtual plant itself. Raises UsageError if it is served in real time."""
        if self._thread is not None:
            raise UsageError("this plant is served in real time; make it without listen= to steer it")
        return self._plant

    def line(self, name: str) -> WatchedLine:
        """Return the line with this name. Raises UsageError if there is none."""
        return self.lines[self._plant.plant.line(name).name]

    def drive(self, name: str) -> WatchedDrive:
        """Return the drive with this name. Raises UsageError if there is none."""
        return self.drives[self._plant.plant.drive(name).name]

    def close(self) -> None:
        """Stop serving; received telegrams stay available. Called automatically at the end of the test."""
        if self._thread is not None:
            self._thread.close()


def watched_plant(plant: Plant, *, in_real_time: bool, faults: FaultPlan | None = None) -> WatchedPlant:
    """Make a plant, served at the addresses of its lines or in virtual time. Raises UsageError, PortError.

    faults: for all its lines, in place of their noise.
    """
    protocols = {drive.name: installed[drive.protocol] for drive in plant.drives}
    records: defaultdict[str, Record] = defaultdict(Record)
    virtual = VirtualPlant(plant, around=lambda name, drive: RecordingDrive(protocols[name], drive, records[name]))
    for line in virtual.lines.values():
        line.faults = faults or line.faults
    tolerance_s = SERVED_TOLERANCE_S if in_real_time else 0.0
    traces = virtual.watch(tolerance_s=tolerance_s)
    server = PlantServer(virtual) if in_real_time else None
    thread = None if server is None else ServingThread(server)
    lines = {}
    for name, line in virtual.lines.items():
        planted = [virtual.drive(drive.name) for drive in plant.on_line(name)]
        drives = [WatchedDrive(each.name, each, records[each.name], each.type.new) for each in planted]
        address = server.addresses[name] if server is not None else ""
        lines[name] = WatchedLine(line, drives, traces[name], thread, address)
    return WatchedPlant(virtual, lines, thread)
