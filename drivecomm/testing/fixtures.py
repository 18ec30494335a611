"""What the pytest fixtures make: watched virtual lines, each closed with the others."""

from __future__ import annotations

from collections import deque
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.models import load_model
from drivecomm.plant import FaultPlan, Plant, read_plant
from drivecomm.protocol import DriveConfig, installed, parse_drive
from drivecomm.testing.line_trace import LineTrace
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.testing.sites import InProcess, Served, served
from drivecomm.testing.watched_line import WatchedDrive, WatchedLine
from drivecomm.testing.watched_plant import watched_plant
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from types import TracebackType

    from drivecomm.protocol import Model
    from drivecomm.testing.watched_plant import WatchedPlant

_MOST_TRACES = 8
"""Property tests make a line for each example, and the last ones are those that failed."""


MakesLine: TypeAlias = "Callable[..., WatchedLine]"
"""The fixture `virtual_line`: see `LineMaker.line`."""

MakesDrive: TypeAlias = "Callable[..., WatchedDrive]"
"""The fixture `virtual_drive`: see `LineMaker.drive`."""

MakesPlant: TypeAlias = "Callable[..., WatchedPlant]"
"""The fixture `virtual_plant`: see `LineMaker.plant`."""


class LineMaker:
    """Makes watched lines and closes all of them when it is left.

    seed: the course of faults that are given as a rate; the second line of a test has the next seed, and so on. folder:
    makes a new folder for a pseudo-terminal's name.
    """

    def __init__(self, seed: int, *, folder: Callable[[], Path]) -> None:
        self._seed = seed
        self._folder = folder
        self._made = 0
        self._last: deque[_Made] = deque(maxlen=_MOST_TRACES)
        self._open = ExitStack()
        self._models: dict[tuple[str, str], Model] = {}

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
        drive's baud rate; in virtual time they always do. Raises UsageError for anything that cannot be, and PortError
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
        made = watched_plant(known, None if listen is None else self._place_for(listen))
        self._open.enter_context(closing(made))
        for name, line in made.lines.items():
            self._made += 1
            self._last.append(_Made(line=line, name=name, seeded=False))
        return made

    def traces(self) -> Iterator[tuple[str, str]]:
        """Yield a title and the decoded trace of each line; of more than eight, of the last eight."""
        for made in self._last:
            where = made.line.port if isinstance(made.line.port, str) else "in virtual time"
            drives = ", ".join(drive.name for drive in made.line.drives) or "no drives"
            text = "\n".join([*self._faults_told(made), made.line.trace()])
            yield f"line {made.name}: {drives}, {where}", text

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._open.close()

    def _line(
        self, names: list[DriveConfig], *, listen: str | None, faults: float | FaultPlan, echo: bool, paced: bool
    ) -> WatchedLine:
        recorded = {}
        watched = {}
        for name in names:
            if str(name) in recorded:
                raise UsageError(f"{name} is on this line twice; two drives cannot have the same address")
            options = {**name.options, "model": self._model(name)}
            make = partial(virtual_drive, name.protocol, name.address, **options)
            record = Record()
            recorded[str(name)] = drive = RecordingDrive(installed[name.protocol], make(), record)
            watched[str(name)] = WatchedDrive(str(name), drive, record, make)
        drives = list(recorded.values())
        plan = faults if isinstance(faults, FaultPlan) else FaultPlan(rate=_share(faults), seed=self._seed + self._made)
        trace = LineTrace(drives)
        site: InProcess | Served
        if listen is None:
            site = InProcess(VirtualLine(drives, faults=plan, echo=echo), trace)
        else:
            place = self._place(listen)
            site = self._open.enter_context(
                closing(served(drives, place, faults=plan, echo=echo, paced=paced, trace=trace))
            )
        line = WatchedLine(site, watched, trace, plan)
        self._made += 1
        self._last.append(_Made(line=line, name=str(self._made), seeded=plan is not faults))
        return line

    def _model(self, name: DriveConfig) -> Model:
        """Return a drive's model; a property test makes the same drive a hundred times."""
        plugin = installed[name.protocol]
        chosen = name.options.get("model", plugin.default_model)
        if not isinstance(chosen, str):
            return load_model(plugin.package, name.protocol, chosen)
        if (name.protocol, chosen) not in self._models:
            self._models[name.protocol, chosen] = load_model(plugin.package, name.protocol, chosen)
        return self._models[name.protocol, chosen]

    def _place(self, listen: str) -> str:
        return self._place_for(listen)() if listen in ("pty", "tcp", "rfc2217") else listen

    def _place_for(self, listen: str) -> Callable[[], str]:
        """Return what gives a new place of a kind, each time that it is called. Raises UsageError."""
        if listen == "pty":
            return lambda: f"pty:{self._folder() / 'port'}"
        if listen in ("tcp", "rfc2217"):
            return lambda: f"{listen}:127.0.0.1:0"
        raise UsageError(f"a plant is served at pty, tcp or rfc2217, and not at {listen!r}")

    def _faults_told(self, made: _Made) -> list[str]:
        plan = made.line.faults
        if not plan.rate:
            return []
        happened = ", ".join(f"{fault.value} {count}" for fault, count in plan.happened.items()) or "none yet"
        again = f"; the same again with --drivecomm-seed={self._seed}" if made.seeded else ""
        return [f"faults: rate {plan.rate}, seed {plan.seed}{again}; happened: {happened}"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """A line, its name or number in its test, and whether its faults are those of the option --drivecomm-seed."""

    line: WatchedLine
    name: str
    seeded: bool


def _share(rate: float) -> float:
    if not 0 <= rate <= 1:
        raise UsageError(f"faults are a share of the transmissions from 0 to 1, and not {rate}")
    return rate
