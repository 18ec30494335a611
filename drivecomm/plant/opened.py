"""Plant as its masters use it: drives by name, on lines that are opened when they are needed.

    with open_plant("plant.toml") as plant:
        pump = plant.drive("pump")
        print(pump.read("output_frequency"))

A drive that is not armed in the plant is read-only: writes and commands raise UsageError before anything is sent.
Stops are always allowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any, Self, Unpack

from drivecomm import bus as buses
from drivecomm.errors import PortError, UsageError, counted
from drivecomm.plant.files import read_plant
from drivecomm.plant.served import bus_of_server
from drivecomm.protocol import LINE_FACT_NAMES, Stop, way_to_stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import BlockingLine, Bus, Drive, LineOptions, OnResult, StopResult
    from drivecomm.link import Port
    from drivecomm.plant.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig, StopName

DEFAULT_FILE = Path("plant.toml")
_OWN_OPTIONS = ("own_ports", "server")


class OpenPlant(Mapping[str, "Drive"]):
    """Drives of a plant by name; a lookup opens the line of the drive. Safe for use from many threads.

    plant: the description of the plant. file: file name in errors; by default the file of the plant. port_of: returns
    the port of a line, or a function that opens it, instead of the port in the plant; None for the plant's ports.
    opening: further keywords of `open_bus`, for all lines; they override the settings of lines and drives in the plant.
    own_ports: open the ports directly even if a server has them; by default such lines are reached through the server.
    server: never open a port here, so that after the end of the server no command bypasses its rights and audit.
    holding: context manager that is entered with each port opened here and its bus, and left when the port closes.
    """

    @buses.lists_line_options
    def __init__(
        self,
        plant: Plant,
        file: str = "",
        *,
        port_of: Callable[[PlantLine], str | Callable[[], Port]] | None = None,
        own_ports: bool = False,
        server: bool = False,
        holding: Callable[[str, Bus], AbstractContextManager[object]] | None = None,
        **opening: Unpack[LineOptions],
    ) -> None:
        self.file = file or plant.file or str(DEFAULT_FILE)
        self.plant = replace(plant, file=self.file)
        self._port_of = port_of or self._said_port
        if own_ports and server:
            raise UsageError(
                "own_ports=True and server=True exclude each other; leave one of them out",
                says=("own_ports=True", "server=True"),
            )
        buses.check_line_options(opening, _OWN_OPTIONS)
        self._own_ports, self._server = own_ports, server
        self._holding = holding
        self._opening = dict(opening)
        # One guard for each line, so that a slow port does not delay the other lines.
        self._guards = {line.name: RLock() for line in plant.lines}
        self._stack = ExitStack()
        self._lines: dict[str, BlockingLine] = {}
        self._drives: dict[str, Drive] = {}

    @property
    def drives(self) -> Mapping[str, Drive]:
        """All drives by name, in the order of the plant; a lookup opens the line of the drive."""
        return self

    def drive(self, name: str) -> Drive:
        """Return a drive by its name, or by PROTOCOL:ADDRESS if only one drive has it; opens its line.

        Raises UsageError for a name that the plant does not have, PortError if its line cannot be opened.
        """
        found = self.plant.drive(name)
        with self._guards[found.line]:
            if found.name not in self._drives:
                self._drives[found.name] = self._made(found)
            return self._drives[found.name]

    def group(self, name: str) -> list[Drive]:
        """Return the drives of a group, in the order of the plant; opens their lines.

        Raises UsageError for a group that the plant does not have, PortError if a line cannot be opened.
        """
        return [self.drive(each.name) for each in self.plant.group(name)]

    def bus(self, line: str) -> BlockingLine:
        """Return the bus of a line, which the first call opens. Raises the same errors as `drive`."""
        found = self.plant.line(line)
        with self._guards[line]:
            if line not in self._lines:
                given = {key: value for key, value in self._opening.items() if value is not None}
                opening = {**found.opening, **given}
                self._lines[line] = self._opened(self._port_of(found), opening)
            return self._lines[line]

    def stop_all(self, how: Stop | StopName = Stop.RAMP, *, on_result: OnResult | None = None) -> list[StopResult]:
        """Stop all motors of the plant, armed or not, and return the result of each stop, drive by drive.

        The lines are stopped concurrently, each as in `Bus.stop_all`; lines that are not open are opened. No failure of
        a drive or a line raises an error. on_result: called with each result as it arrives, in the thread of its line.
        """
        from drivecomm.plant.stopping import stop_everything, stop_lines

        return stop_lines(stop_everything, self._by_line(self.plant.drives), self.bus, way_to_stop(how), on_result)

    def stop_group(
        self, name: str, how: Stop | StopName = Stop.RAMP, *, on_result: OnResult | None = None
    ) -> list[StopResult]:
        """Stop only the motors of a group, armed or not, and return the result of each stop, as `stop_all`.

        Raises UsageError for a group that the plant does not have. No failure of a drive or a line raises an error.
        """
        from drivecomm.plant.stopping import stop_lines, stop_only

        return stop_lines(stop_only, self._by_line(self.plant.group(name)), self.bus, way_to_stop(how), on_result)

    def close(self) -> None:
        """Close all open lines; a later lookup of a drive opens its line again."""
        self._drives.clear()
        self._lines.clear()
        self._stack.close()

    def __repr__(self) -> str:
        there = f"{counted(len(self), 'drive')} on {counted(len(self.plant.lines), 'line')}"
        return f"<{type(self).__name__} {self.file}, {there}, {len(self._lines)} of them open>"

    def __getitem__(self, name: str) -> Drive:
        """Return a drive by its name in the plant."""
        if name not in list(self):
            raise KeyError(name)
        return self.drive(name)

    def __iter__(self) -> Iterator[str]:
        return iter([drive.name for drive in self.plant.drives])

    def __len__(self) -> int:
        return len(self.plant.drives)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _by_line(self, drives: Iterable[DriveConfig]) -> dict[str, list[DriveConfig]]:
        """Return drives grouped by line, with the line options of this object applied."""
        facts = {key: value for key, value in self._opening.items() if key in LINE_FACT_NAMES and value is not None}
        found: dict[str, list[DriveConfig]] = {}
        for drive in drives:
            found.setdefault(drive.line, []).append(drive.with_options(**facts))
        return found

    def _made(self, found: DriveConfig) -> Drive:
        bus = self.bus(found.line)
        facts = {key: value for key, value in self._opening.items() if key in LINE_FACT_NAMES and value is not None}
        known = replace(found.with_options(**facts), read_only_reason=found.why_read_only(self.file))
        try:
            return known.build(bus.drive)
        except UsageError as error:
            raise UsageError(f"{self.file}: drive {found.name}: {error}") from error

    def _opened(self, port: str | Callable[[], Port], opening: Mapping[str, Any]) -> BlockingLine:
        if isinstance(port, str) and not self._own_ports and (served := bus_of_server(port, **opening)) is not None:
            return self._stack.enter_context(served)
        if self._server:
            raise PortError(
                f"{port}: no server has this port, and server=True opens none; start drivecomm serve {self.file}, or "
                "leave server=True out",
                says="server=True",
            )
        bus = self._stack.enter_context(buses.open_bus(port, **opening))
        if isinstance(port, str) and self._holding is not None:
            self._stack.enter_context(self._holding(port, bus))
        return bus

    def _said_port(self, line: PlantLine) -> str:
        if not line.reached_at:
            raise UsageError(f'{self.file}: line {line.name} has no port; write port = "/dev/ttyUSB0" there')
        return line.reached_at


@buses.lists_line_options
def open_plant(
    file: str | Path = DEFAULT_FILE,
    *,
    own_ports: bool = False,
    server: bool = False,
    **opening: Unpack[LineOptions],
) -> OpenPlant:
    """Read a plant file and return its drives, a context manager; a line is opened when a drive on it is looked up.

    Lines that a server has (`drivecomm serve`) are reached through it, with the same verbs, results and errors.
    own_ports: open the ports directly, which raises PortError if a server has them. server: use only a server; the
    lookup of a drive raises PortError if no server has its line. opening: for all lines, see
    `help(drivecomm.LineOptions)`. Raises FileFormatError for a file that is not a plant, UsageError for an unknown
    option.
    """
    return OpenPlant(read_plant(Path(file)), own_ports=own_ports, server=server, **opening)
