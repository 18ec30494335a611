"""What is to be watched: lines and the drives on them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.protocol import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from drivecomm.link import Port
    from drivecomm.plant import Plant


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedDrive:
    """A drive. name: what people call it, PROTOCOL:ADDRESS if empty. options: what `Bus.drive` takes.

    armed: it may be commanded by what runs unattended; stopping is allowed always. link_loss: what its motor does when
    its master falls silent, empty when nobody has said so; a drive is started only where it is said.
    """

    protocol: str
    address: int
    name: str = ""
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    armed: bool = False
    link_loss: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.place)

    @property
    def place(self) -> str:
        """The drive as the command line names it."""
        return f"{self.protocol}:{self.address}"


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedLine:
    """A line. port, options: what `open_bus` takes, such as baudrate, attempts or echo."""

    name: str
    port: str | Callable[[], Port]
    drives: tuple[WatchedDrive, ...]
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.drives:
            raise UsageError(f"line {self.name} has no drives to watch; name some")


def lines_of(plant: Plant, options: Mapping[str, Any] | None = None) -> list[WatchedLine]:
    """Return the lines of a plant that have drives. options: for all lines; they go before what the plant says.

    Raises UsageError for a line without a port.
    """
    return [_line_of(plant, name, options or {}) for name in _names(plant)]


def _names(plant: Plant) -> Iterable[str]:
    names = [line.name for line in plant.lines if plant.on_line(line.name)]
    if not names:
        raise UsageError("the plant has no drives to watch; write a [[drive]] for each")
    return names


def _line_of(plant: Plant, name: str, options: Mapping[str, Any]) -> WatchedLine:
    line = next(line for line in plant.lines if line.name == name)
    if not line.reached_at:
        raise UsageError(f'line {name} has no port; write port = "/dev/ttyUSB0" or what a master opens to reach it')
    given = {key: value for key, value in options.items() if value is not None}
    facts = {key: value for key, value in given.items() if key in LINE_FACT_NAMES}
    drives = tuple(
        WatchedDrive(
            protocol=drive.protocol,
            address=drive.address,
            name=drive.name,
            options={**drive.options, **facts},
            armed=drive.armed,
            link_loss=drive.link_loss.policy if drive.link_loss else "",
        )
        for drive in plant.on_line(name)
    )
    echo = {"echo": True} if line.echo else {}
    return WatchedLine(name=name, port=line.reached_at, drives=drives, options={**echo, **line.settings, **given})
