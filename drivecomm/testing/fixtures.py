"""Makers behind the pytest fixtures: watched virtual lines, all closed together."""

from __future__ import annotations

from collections import deque
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.plant import FaultPlan, Plant, PlantLine, read_plant, script_of
from drivecomm.protocol import DriveConfig, parse_drive
from drivecomm.testing.pyserial import serial_url
from drivecomm.testing.recording import violation_list
from drivecomm.testing.watched_plant import WatchedPlant, watched_plant
from drivecomm.testing.watched_server import WatchedServer, folders_of_servers
from drivecomm.virtual import separate_drive_keys

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.plant import Faults
    from drivecomm.protocol import Model
    from drivecomm.testing.watched_line import WatchedDrive, WatchedLine

_LINE = "line"
_MOST_TRACES = 8
"""Limit of printed traces: a property test makes a line for each example, and the last ones are those that failed."""


MakesLine: TypeAlias = "Callable[..., WatchedLine]"
"""Type of the fixture `virtual_line`: see `LineMaker.line`."""

MakesDrive: TypeAlias = "Callable[..., WatchedDrive]"
"""Type of the fixture `virtual_drive`: see `LineMaker.drive`."""

MakesPlant: TypeAlias = "Callable[..., WatchedPlant]"
"""Type of the fixture `virtual_plant`: see `LineMaker.plant`."""

MakesServer: TypeAlias = "Callable[..., WatchedServer]"
"""Type of the fixture `served_plant`: see `LineMaker.server`."""


class LineMaker:
    """Maker of watched lines, which closes all of them on exit; used by the fixtures, and by tests without pytest.

    seed: random seed of faults that are given as a rate; each further line of a test has the next higher seed. folder:
    makes a new folder for the name of a pseudo-terminal; a temporary one if absent.
    """

    def __init__(self, seed: int = 0, *, folder: Callable[[], Path] | None = None) -> None:
        self.seed = seed
        self._folder = self._temporary_folder if folder is None else folder
        self._made = 0
        self._has_folders = False
        self._last: deque[tuple[str, WatchedLine, str]] = deque(maxlen=_MOST_TRACES)
        self._open = ExitStack()

    def line(
        self,
        drives: Iterable[str],
        *,
        listen: str | None = None,
        faults: float | FaultPlan | Faults = 0.0,
        echo: bool = False,
        paced: bool = False,
    ) -> WatchedLine:
        """Make a line with these virtual drives.

        drives: as the command line names them, `PROTOCOL:ADDRESS` with options after commas:
        "vabus:1,model=act,reply_delay_s=0.2".

        listen: None for a line in this process, in virtual time; "pty", "tcp" or "rfc2217" for a line that is served to
        any program on this machine, in real time; or an address as for `drivecomm simulate --listen`. "virtual" is the
        same as None, except that the port is a URL that `serial.serial_for_url` opens in this process.

        faults: the share of transmissions that are disturbed, 0 to 1; or a fault plan; or one or several faults as in a
        plant file: {"kind": "drop", "of": "reply to a write", "every": 3}.

        echo: the master receives its own bytes. paced: on a served line, characters take as long as at the drive's baud
        rate; in virtual time they always do.

        Raises UsageError for invalid arguments, and PortError if the address is in use.
        """
        names = [parse_drive(text) for text in drives]
        return self._line(names, listen=listen, faults=faults, echo=echo, paced=paced)

    def drive(
        self,
        name: str,
        *,
        listen: str | None = None,
        faults: float | FaultPlan | Faults = 0.0,
        echo: bool = False,
        paced: bool = False,
        model: str | Path | Model | None = None,
        **options: Any,
    ) -> WatchedDrive:
        """Make a line with one virtual drive on it, and return the drive.

        model, options: as `drivecomm.virtual.virtual_drive` takes them, plus the keys of a virtual drive in a plant
        file: needs_pause_s, reply_delay_s, values, motor. The other arguments are those of `line`.
        """
        named = parse_drive(name)
        named = named.with_options(**(options if model is None else {"model": model, **options}))
        return self._line([named], listen=listen, faults=faults, echo=echo, paced=paced).drives[0]

    def plant(self, plant: str | Path | Plant, *, listen: str | None = None) -> WatchedPlant:
        """Make a whole plant: the lines, drives and fault script of a file, or of a `Plant`.

        listen: None for lines in this process, in virtual time; "pty", "tcp" or "rfc2217" for lines that are served in
        real time, each at an address of its own; the addresses in the file are ignored. Raises FileFormatError and
        UsageError for an invalid plant.
        """
        known = plant if isinstance(plant, Plant) else read_plant(Path(plant))
        if listen is not None:
            if listen not in ("pty", "tcp", "rfc2217"):
                raise UsageError(f"a plant is served at pty, tcp or rfc2217, not at {listen!r}")
            known = replace(known, lines=tuple(replace(line, listen=self._place(listen)) for line in known.lines))
        made = watched_plant(known, in_real_time=listen is not None)
        self._open.enter_context(closing(made))
        self._made += len(made.lines)
        self._last.extend((name, line, "") for name, line in made.lines.items())
        return made

    def server(self, plant: str | Path) -> WatchedServer:
        """Make the plant of a file, in real time, and serve it to this process and others as `drivecomm serve` does.

        Each line is served at an address of its own, and the HTTP door at a free port. Raises FileFormatError,
        UsageError and PortError.
        """
        if not self._has_folders:
            self._open.enter_context(folders_of_servers())
            self._has_folders = True
        path = Path(plant)
        return self._open.enter_context(closing(WatchedServer(path, self.plant(path, listen="tcp"))))

    def _temporary_folder(self) -> Path:
        return Path(self._open.enter_context(TemporaryDirectory(prefix="drivecomm-")))

    def traces(self) -> Iterator[tuple[str, str]]:
        """Yield a title and the decoded trace of each line; at most the last eight lines."""
        for name, line, again in self._last:
            where = line.port if isinstance(line.port, str) else "in virtual time"
            drives = ", ".join(drive.name for drive in line.drives) or "no drives"
            plan, head = line.faults, ""
            if plan.rate:
                happened = ", ".join(f"{fault.value} {count}" for fault, count in plan.happened.items()) or "none yet"
                head = f"faults: rate {plan.rate}, seed {plan.seed}{again}; happened: {happened}\n"
            head += "".join(f"{text}\n" for text in line.scripted)
            if line.violations:
                head += f"violations:\n{violation_list(line.violations)}\n"
            yield f"line {name}: {drives}, {where}", head + line.trace()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def _line(
        self,
        names: list[DriveConfig],
        *,
        listen: str | None,
        faults: float | FaultPlan | Faults,
        echo: bool,
        paced: bool,
    ) -> WatchedLine:
        for number, name in enumerate(names):
            if str(name) in map(str, names[:number]):
                raise UsageError(f"{name} is on this line twice; two drives cannot have the same address")
        served = listen not in (None, "virtual")
        plan, again = faults if isinstance(faults, FaultPlan) else None, ""
        if isinstance(faults, int | float):
            if not 0 <= faults <= 1:
                raise UsageError(f"faults are a share of the transmissions from 0 to 1, and not {faults}")
            plan = FaultPlan(rate=faults, seed=self.seed + self._made)
            again = f"; the same again with --drivecomm-seed={self.seed}"
        place = self._place(listen) if listen is not None and served else ""
        on_line = PlantLine(name=_LINE, listen=place, echo=echo, paced=paced or not served)
        plant = Plant(
            lines=(on_line,),
            drives=tuple(separate_drive_keys(name, line=_LINE) for name in names),
            script=()
            if isinstance(faults, int | float | FaultPlan)
            else script_of(faults, line=_LINE, drives=[*map(str, names)], seed=self.seed + self._made),
        )
        made = watched_plant(plant, in_real_time=served, faults=plan)
        self._open.enter_context(closing(made))
        line = made.lines[_LINE]
        if listen == "virtual":
            line.opened_as(serial_url(line.virtual))
        self._made += 1
        self._last.append((str(self._made), line, again))
        return line

    def _place(self, listen: str) -> str:
        """Return a new listening address of a kind; any other text is returned as the address itself."""
        if listen == "pty":
            return f"pty:{self._folder() / 'port'}"
        return f"{listen}:127.0.0.1:0" if listen in ("tcp", "rfc2217") else listen
