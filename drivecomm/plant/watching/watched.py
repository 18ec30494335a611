"""What is to be watched: lines and the drives on them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.protocol import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.link import Port
    from drivecomm.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedLine:
    """A line. port, options: what `open_bus` takes, such as baudrate, attempts or echo."""

    name: str
    port: str | Callable[[], Port]
    drives: tuple[DriveConfig, ...]
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.drives:
            raise UsageError(f"line {self.name} has no drives to watch; name some")


def lines_of(plant: Plant, options: Mapping[str, Any] | None = None) -> list[WatchedLine]:
    """Return the lines of a plant that have drives. options: for all lines; they go before what the plant says.

    Raises UsageError for a line without a port.
    """
    lines = [_line_of(plant, line, options or {}) for line in plant.lines if plant.on_line(line.name)]
    if not lines:
        raise UsageError("the plant has no drives to watch; write a [[drive]] for each")
    return lines


def _line_of(plant: Plant, line: PlantLine, options: Mapping[str, Any]) -> WatchedLine:
    if not line.reached_at:
        raise UsageError(
            f'line {line.name} has no port; write port = "/dev/ttyUSB0" or what a master opens to reach it'
        )
    given = {key: value for key, value in options.items() if value is not None}
    facts = {key: value for key, value in given.items() if key in LINE_FACT_NAMES}
    drives = tuple(drive.with_options(**facts) for drive in plant.on_line(line.name))
    echo = {"echo": True} if line.echo else {}
    return WatchedLine(name=line.name, port=line.reached_at, drives=drives, options={**echo, **line.settings, **given})
