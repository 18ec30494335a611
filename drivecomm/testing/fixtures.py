"""What the pytest fixtures make: watched virtual lines, each closed with the others."""

from __future__ import annotations

from collections import deque
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.models import load_model
from drivecomm.plant import FaultPlan, Plant, read_plant
from drivecomm.protocol import DriveConfig, installed, parse_drive
from drivecomm.testing.line_trace import LineTrace
from drivecomm.testing.pyserial import serial_url
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.testing.watched_line import ServingThread, WatchedDrive, WatchedLine
from drivecomm.testing.watched_plant import WatchedPlant, watched_plant
from drivecomm.testing.watched_server import WatchedServer, folders_of_servers
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.protocol import Model

_MOST_TRACES = 8
"""Property tests make a line for each example, and the last ones are those that failed."""


MakesLine: TypeAlias = "Callable[..., WatchedLine]"
"""The fixture `virtual_line`: see `LineMaker.line`."""

MakesDrive: TypeAlias = "Callable[..., WatchedDrive]"
"""The fixture `virtual_drive`: see `LineMaker.drive`."""

MakesPlant: TypeAlias = "Callable[..., WatchedPlant]"
"""The fixture `virtual_plant`: see `LineMaker.plant`."""

MakesServer: TypeAlias = "Callable[..., WatchedServer]"
"""The fixture `served_plant`: see `LineMaker.server`."""


class LineMaker:
    """Makes watched lines and closes all of them when it is left.

    seed: the course of faults that are given as a rate; the second line of a test has the next seed, and so on. folder:
    makes a new folder for a pseudo-terminal's name.
    """

    def __init__(self, seed: int, *, folder: Callable[[], Path]) -> None:
        self._seed = seed
        self._folder = folder
        self._made = 0
        self._has_folders = False
        self._last: deque[tuple[str, WatchedLine, str]] = deque(maxlen=_MOST_TRACES)
        self._open = ExitStack()

    def line(
        self,
        drives: Iterable[str],
        *,
        listen: str | None = None,
        faults: float | FaultPlan = 0.0,
        echo: bool = False,
        paced: bool = False,
    ) -> WatchedLine:
        """Make a line with these virtual drives on it.

        drives: as the command line names them, `PROTOCOL:ADDRESS` with options after commas:
        "vabus:1,model=act,reply_delay_s=0.2". listen: None for a line in this process, in virtual time; "pty", "tcp" or
        "rfc2217" for a line that is served to any program on this machine, in real time; or a place, as
        `drivecomm simulate --listen` takes it. faults: the share of transmissions that are disturbed, 0 to 1, or a
        plan. echo: the master hears itself. paced: on a served line, characters take the time that they take at the
        drive's baud rate; in virtual time they always do. "virtual": as None, and port is a URL that
        `serial.serial_for_url` opens in this process. Raises UsageError for anything that cannot be, and PortError
        when the place is taken.
        """
        names = [parse_drive(text) for text in drives]
        return self._line(names, listen=listen, faults=faults, echo=echo, paced=paced)

    def drive(
        self,
        name: str,
        *,
        listen: str | None = None,
        faults: float | FaultPlan = 0.0,
        echo: bool = False,
        paced: bool = False,
        model: str | Path | Model | None = None,
        **options: Any,
    ) -> WatchedDrive:
        """Make a line with one virtual drive on it, and return the drive.

        model, options: as `drivecomm.virtual.virtual_drive` takes them. The rest is as with `line`.
        """
        named = parse_drive(name)
        named = named.with_options(**(options if model is None else {"model": model, **options}))
        return self._line([named], listen=listen, faults=faults, echo=echo, paced=paced).drives[0]

    def plant(self, plant: str | Path | Plant, *, listen: str | None = None) -> WatchedPlant:
        """Make a whole plant: the lines, drives and fault script of a file, or of a `Plant`.

        listen: None for lines in this process, in virtual time; "pty", "tcp" or "rfc2217" for lines that are served, in
        real time, each at a place of its own; where the file says to listen is ignored. Raises FileFormatError and
        UsageError for what cannot be.
        """
        known = plant if isinstance(plant, Plant) else read_plant(Path(plant))
        if listen is not None:
            if listen not in ("pty", "tcp", "rfc2217"):
                raise UsageError(f"a plant is served at pty, tcp or rfc2217, and not at {listen!r}")
            known = replace(known, lines=tuple(replace(line, listen=self._place(listen)) for line in known.lines))
        made = watched_plant(known, in_real_time=listen is not None)
        self._open.enter_context(closing(made))
        self._made += len(made.lines)
        self._last.extend((name, line, "") for name, line in made.lines.items())
        return made

    def server(self, plant: str | Path) -> WatchedServer:
        """Make the plant of a file, in real time, and serve it to this process and others as `drivecomm serve` does.

        Its lines are served at places of their own, and its HTTP door at a free port. Raises FileFormatError,
        UsageError and PortError for what cannot be.
        """
        if not self._has_folders:
            self._open.enter_context(folders_of_servers())
            self._has_folders = True
        path = Path(plant)
        return self._open.enter_context(closing(WatchedServer(path, self.plant(path, listen="tcp"))))

    def traces(self) -> Iterator[tuple[str, str]]:
        """Yield a title and the decoded trace of each line; of more than eight, of the last eight."""
        for name, line, again in self._last:
            where = line.port if isinstance(line.port, str) else "in virtual time"
            drives = ", ".join(drive.name for drive in line.drives) or "no drives"
            plan, head = line.faults, ""
            if plan.rate:
                happened = ", ".join(f"{fault.value} {count}" for fault, count in plan.happened.items()) or "none yet"
                head = f"faults: rate {plan.rate}, seed {plan.seed}{again}; happened: {happened}\n"
            yield f"line {name}: {drives}, {where}", head + line.trace()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def _line(
        self, names: list[DriveConfig], *, listen: str | None, faults: float | FaultPlan, echo: bool, paced: bool
    ) -> WatchedLine:
        drives: dict[str, RecordingDrive] = {}
        watched = []
        for name in names:
            if str(name) in drives:
                raise UsageError(f"{name} is on this line twice; two drives cannot have the same address")
            make = partial(virtual_drive, name.protocol, name.address, **{**name.options, "model": self._model(name)})
            record = Record()
            drives[str(name)] = RecordingDrive(installed[name.protocol], make(), record)
            watched.append(WatchedDrive(str(name), drives[str(name)], record, make))
        plan, again = faults, ""
        if not isinstance(plan, FaultPlan):
            if not 0 <= plan <= 1:
                raise UsageError(f"faults are a share of the transmissions from 0 to 1, and not {plan}")
            plan = FaultPlan(rate=plan, seed=self._seed + self._made)
            again = f"; the same again with --drivecomm-seed={self._seed}"
        if listen in (None, "virtual"):
            on_line, served = VirtualLine(drives.values(), faults=plan, echo=echo), None
            trace = LineTrace(on_line)
            url = serial_url(on_line) if listen else ""
        else:
            server = Server(drives.values(), parse_listen(self._place(listen)), echo=echo, paced=paced)
            on_line = server.line
            on_line.faults = plan
            trace = LineTrace(on_line)
            served, url = self._open.enter_context(closing(ServingThread(server))), server.address
        line = WatchedLine(on_line, watched, trace, served, url)
        self._made += 1
        self._last.append((str(self._made), line, again))
        return line

    def _model(self, name: DriveConfig) -> Model:
        plugin = installed[name.protocol]
        chosen = name.options.get("model", plugin.default_model)
        return load_model(plugin.package, name.protocol, chosen)

    def _place(self, listen: str) -> str:
        """Return a new place of a kind; any other text is a place itself."""
        if listen == "pty":
            return f"pty:{self._folder() / 'port'}"
        return f"{listen}:127.0.0.1:0" if listen in ("tcp", "rfc2217") else listen
