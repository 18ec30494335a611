"""A plant from its masters' side: its drives by name, on lines that are opened when they are needed.

    with open_plant("plant.toml") as plant:
        pump = plant.drive("pump")
        print(pump.read("output_frequency"))

A drive that the plant does not arm is read-only: what writes or commands raises UsageError before anything is sent.
Stopping it is always allowed.
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
    """The drives of a plant by name; looking one up opens its line. May be used from many threads.

    plant: what there is. file: what errors call it, where it was read unless given. port_of: what to open for a line
    instead of the port that the plant names, such as a function that returns a port; None for that. opening: further
    keywords of `open_bus`, for all lines; what is given goes before what the plant says of a line or a drive.
    own_ports: open the ports themselves, also where a server has them; otherwise everything goes through it then.
    server: never open a port here, so that whatever ends the server, nothing is commanded without its rights and audit.
    holding: entered with each port that is opened here and its bus, for as long as it is open.
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
        # One for each line: a port that takes long to open does not hold up the others.
        self._guards = {line.name: RLock() for line in plant.lines}
        self._stack = ExitStack()
        self._lines: dict[str, BlockingLine] = {}
        self._drives: dict[str, Drive] = {}

    @property
    def drives(self) -> Mapping[str, Drive]:
        """All drives by name, in the order of the plant; looking one up opens its line."""
        return self

    def drive(self, name: str) -> Drive:
        """Return a drive by its name, or by PROTOCOL:ADDRESS where that is one drive only; opens its line.

        Raises UsageError for a name that the plant does not have, PortError when its line cannot be opened.
        """
        found = self.plant.drive(name)
        with self._guards[found.line]:
            if found.name not in self._drives:
                self._drives[found.name] = self._made(found)
            return self._drives[found.name]

    def group(self, name: str) -> list[Drive]:
        """Return the drives of a group, in the order of the plant; opens their lines.

        Raises UsageError for a group that the plant does not have, PortError when a line cannot be opened.
        """
        return [self.drive(each.name) for each in self.plant.group(name)]

    def bus(self, line: str) -> BlockingLine:
        """Return the bus of a line, opened when it is asked for first. Raises as `drive` does."""
        found = self.plant.line(line)
        with self._guards[line]:
            if line not in self._lines:
                given = {key: value for key, value in self._opening.items() if value is not None}
                opening = {**found.opening, **given}
                self._lines[line] = self._opened(self._port_of(found), opening)
            return self._lines[line]

    def stop_all(self, how: Stop | StopName = Stop.RAMP, *, on_result: OnResult | None = None) -> list[StopResult]:
        """Stop all motors of the plant, armed or not, and return what came of each stop, drive by drive.

        All lines concurrently, each as `Bus.stop_all` stops it; lines that are not open are opened. Nothing is raised
        for a drive or a line. on_result: called with each outcome as it comes, in the thread of its line.
        """
        from drivecomm.plant.stopping import stop_everything, stop_lines

        return stop_lines(stop_everything, self._by_line(self.plant.drives), self.bus, way_to_stop(how), on_result)

    def stop_group(
        self, name: str, how: Stop | StopName = Stop.RAMP, *, on_result: OnResult | None = None
    ) -> list[StopResult]:
        """Stop the motors of a group, armed or not, and no other, and return what came of each stop, as `stop_all`.

        Raises UsageError for a group that the plant does not have, and nothing for a drive or a line.
        """
        from drivecomm.plant.stopping import stop_lines, stop_only

        return stop_lines(stop_only, self._by_line(self.plant.group(name)), self.bus, way_to_stop(how), on_result)

    def close(self) -> None:
        """Close all lines that were opened; a drive that is looked up afterwards opens its line again."""
        self._drives.clear()
        self._lines.clear()
        self._stack.close()

    def __repr__(self) -> str:
        there = f"{counted(len(self), 'drive')} on {counted(len(self.plant.lines), 'line')}"
        return f"<{type(self).__name__} {self.file}, {there}, {len(self._lines)} of them open>"

    def __getitem__(self, name: str) -> Drive:
        """Return a drive by the name that the plant gives it."""
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
        """Return drives by their lines, with what was said here of all lines."""
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
    """Read a plant file and return its drives, a context manager; nothing is opened before a drive is looked up.

    Lines that a server has (`drivecomm serve`) are reached through it, with the same verbs, results and errors.

    own_ports: open the ports themselves, which is a PortError where a server has them. server: insist on the server; a
    line that none has is a PortError when it is looked up. opening: for all lines, see `help(drivecomm.LineOptions)`.
    Raises FileFormatError for a file that is not a plant, UsageError for an unknown option.
    """
    return OpenPlant(read_plant(Path(file)), own_ports=own_ports, server=server, **opening)
