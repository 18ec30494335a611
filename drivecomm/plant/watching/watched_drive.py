"""Watched lines, the drives on them, and the results of their requests."""

from __future__ import annotations

import logging
from collections import deque
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    DriveCommError,
    DriveError,
    LineBusyError,
    LinkError,
    OvertakenError,
    ReplyError,
    UsageError,
)
from drivecomm.line import STATUS
from drivecomm.protocol import LINE_FACT_NAMES, Reading

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import AsyncDrive, AwaitedLine
    from drivecomm.line import PollResult
    from drivecomm.link import Port, TraceEvent
    from drivecomm.plant import Plant, PlantLine
    from drivecomm.plant.watching.board import DriveView, Trend
    from drivecomm.protocol import DriveConfig, DriveStatus

_KEPT_TELEGRAMS = 400

_NOT_ASKED = OvertakenError, LineBusyError
"""Errors that reveal nothing about a drive: a stop took precedence, or other callers had the line."""

_log = logging.getLogger("drivecomm.plant")


def is_silence(error: DriveCommError | None) -> bool:
    """Return whether an error shows that a drive, or its line, does not answer; False if no request was sent.

    A request is not sent if a stop takes precedence, or if other callers have the line.
    """
    return not has_answered(error) and not isinstance(error, _NOT_ASKED)


def has_answered(error: DriveCommError | None) -> bool:
    """Return whether a drive has answered, even with a refusal, if its request ended with this error."""
    return not isinstance(error, ReplyError | LinkError)


@dataclass(slots=True, eq=False)
class TrackedDrive:
    """Watched drive and its known state. A poll plan reads its status as STATUS and its parameters by their names."""

    line: OpenLine
    drive: AsyncDrive
    view: DriveView
    status: DriveStatus | None = None
    fault: str = ""
    answered_s: float | None = None
    trends: dict[str, Trend] = field(default_factory=dict)
    telegrams: deque[TraceEvent] = field(default_factory=lambda: deque(maxlen=_KEPT_TELEGRAMS))

    @property
    def name(self) -> str:
        """Name of the drive on its bus."""
        return self.drive.name

    @property
    def bus(self) -> Any:
        """Bus of the drive."""
        return self.drive.bus

    def view_after(self, result: PollResult, cause: str) -> DriveView:
        """Return the view of the drive after a poll result. cause: reason of a failure, empty on success.

        The view is unchanged if no request was sent, because a stop took precedence or other callers had the line.
        """
        view, error = self.view, result.error
        if isinstance(error, _NOT_ASKED):
            return view
        if is_silence(error):
            return view.silent(cause)
        if result.parameter == STATUS:
            view = replace(view, reachability="answers", late=False, error=cause)
            return view if error is not None else view.with_status(self.status, self.fault)
        return view if view.reachability == "answers" else replace(view, reachability="answers", error="")

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that cannot be read."""
        if parameter != STATUS:
            self.drive.check_read(parameter, **options)

    async def polled(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter as a poll loop does, or the status with its fault.

        A bug of a protocol package raises DriveCommError.
        """
        with self._mistakes_told():
            return await self._asked(parameter, **options)

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return groups of parameters that one telegram reads, as positions in the list."""
        try:
            return self.drive.blocks(parameters)
        except Exception:  # noqa: BLE001 - a bug of one package must not block the polls of other drives
            _log.exception("%s is polled one parameter at a time, because of a mistake in its package", self.name)
            return [[place] for place in range(len(parameters))]

    async def polled_many(self, parameters: Sequence[str]) -> list[Reading]:
        """Read a group from `blocks` as a poll loop does; bugs of a package raise DriveCommError."""
        with self._mistakes_told():
            return await self.drive.polled_many(parameters)

    @contextmanager
    def _mistakes_told(self) -> Iterator[None]:
        try:
            yield
        except DriveCommError:
            raise
        except Exception as error:
            raise DriveCommError(
                f"{self.name} cannot be polled, because of a mistake in its package: {error!r}"
            ) from error

    async def _asked(self, parameter: str, **options: Any) -> Reading:
        if parameter != STATUS:
            return await self.drive.polled(parameter, **options)
        self.status = status = await self.drive.polled_status()
        self.fault = await self._fault_of(status) if status.fault else ""
        return Reading(
            parameter=STATUS,
            name=STATUS,
            value=status.state.value,
            raw=status.word,
            text=self.fault,
            time_s=self.drive.bus.wall_time(),
        )

    async def _fault_of(self, status: DriveStatus) -> str:
        """Return the fault of a tripped drive; read the fault parameter if the status does not contain it."""
        code, text, model = status.fault_code, status.fault_text, self.drive.model
        if code is None and not text and model is not None and "fault_code" in model.quantities:
            # Without a fault number, the drive still has a fault.
            with suppress(UsageError, DriveError):
                reading = await self.drive.polled("fault_code")
                text = reading.text
                code = int(reading.value) if reading.value and not isinstance(reading.value, str) else None
        if code is not None and not text and model is not None:
            text = model.faults.get(code, "")
        if code is None:
            return text or "fault"
        return f"{code} {text}" if text else f"code {code}"


@dataclass(slots=True, eq=False)
class OpenLine:
    """Watched line and its bus. began_s: its clock when watching began. now_s: its clock when it was last open."""

    watched: WatchedLine
    bus: AwaitedLine
    is_open: bool = False
    began_s: float = 0.0
    now_s: float = 0.0

    @property
    def elapsed_s(self) -> float:
        """Seconds for which its drives have been watched."""
        if self.is_open:
            self.now_s = self.bus.now()
        return self.now_s - self.began_s


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedLine:
    """Description of a line to watch. port, options: arguments of `open_bus`, such as baudrate, attempts or echo."""

    name: str
    port: str | Callable[[], Port]
    drives: tuple[DriveConfig, ...]
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.drives:
            raise UsageError(f"line {self.name} has no drives to watch; name some")


def lines_of(plant: Plant, options: Mapping[str, Any] | None = None) -> list[WatchedLine]:
    """Return the lines of a plant that have drives. options: for all lines; they override the plant's settings.

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
    return WatchedLine(name=line.name, port=line.reached_at, drives=drives, options={**line.opening, **given})
