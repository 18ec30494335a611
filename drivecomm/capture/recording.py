"""Recording what a bus sends and receives: a port around the port, so that nothing is lost and nothing costs when off.

    with drivecomm.open_bus("/dev/ttyUSB0", record="pumps.jsonl") as bus:
        ...

A piece that was sent has the time at which its last character is on the wire, as far as line settings tell. One that
was received has the time at which it was fetched from the port: what comes between exchanges is fetched by the next
exchange. An echo that the bus expects is the master's own bytes once more, and not recorded again.
"""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from drivecomm.capture.files import CaptureWriter, check_place
from drivecomm.capture.growing_file import Gaps
from drivecomm.capture.pieces import Piece, Provenance
from drivecomm.errors import FileFormatError, UsageError, shortened
from drivecomm.link import EchoFilter, PortProxy
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.capture.pieces import Source
    from drivecomm.link import Echo, Port
    from drivecomm.protocol import LineSettings

_LOGGER = logging.getLogger("drivecomm.capture")


class Recorder(Protocol):
    """Whoever takes the pieces of a recording."""

    def add(self, piece: Piece) -> None:
        """Take one more."""
        ...


Record: TypeAlias = str | Path | Recorder
"""Where a recording goes: a file by its name, .jsonl or .pcapng, or any object with `add(piece)`."""


class Recording:
    """One recording of one bus, however often its port is lost and opened again.

    open_port: opens the port. record: where the pieces go; an object gets the line settings with each of them. name:
    the port's. echo: how the bus treats an echo. drives: tells the drives that are known on the line. Raises
    UsageError, before anything is sent, for a file that cannot be.
    """

    def __init__(
        self,
        open_port: Callable[[], Port],
        record: Record,
        *,
        name: str = "",
        echo: Echo = "off",
        drives: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        if not isinstance(record, str | Path) and not hasattr(record, "add"):
            raise UsageError(
                f"{shortened(record)} cannot record; give a .jsonl or .pcapng file, or an object with add(piece)"
            )
        self._open_port = open_port
        self._path = Path(record) if isinstance(record, str | Path) else None
        self._recorder: Recorder | None = None if isinstance(record, str | Path) else record
        self._writer: CaptureWriter | None = None
        self._name = name
        self._echo = EchoFilter(echo)
        self._holding = False
        self._drives = drives
        self._clock: Port | None = None
        self._began: datetime | None = None
        self._began_s = 0.0
        self._heard_s = 0.0
        self._busy_until_s = 0.0
        tell = _LOGGER.warning
        self._gaps = Gaps(str(record), kept="pieces", done="recorded", goes_on="the line", tell=tell)
        self._first: LineSettings | None = None
        self._settings: LineSettings | None = None
        self._over = False
        if self._path is not None:
            check_place(self._path)

    def open_port(self) -> Port:
        """Open the port, or open it again; what passes through it is recorded."""
        port = self._open_port()
        if self._clock is None:
            self._began_s = self._busy_until_s = port.now()
            # A virtual line has no time of day.
            self._began = datetime.fromtimestamp(port.wall_time(), UTC) if port.real_time else None
        self._clock = port
        return RecordedPort(port, self)

    def configured(self, settings: LineSettings) -> None:
        """Take note of the line settings of what follows."""
        self._settings = settings
        self._first = self._first or settings

    def sent(self, data: bytes, port: Port) -> None:
        """Record what was handed over for sending."""
        self._let_go_of_echo()
        if self._echo.looking:
            self._echo.sent(data)
        now = port.now()
        if port.paced and self._settings is not None:
            now = max(now, self._busy_until_s) + self._settings.wire_s(len(data))
            self._busy_until_s = now
        self._add(data, "master", now)

    def received(self, data: bytes, port: Port) -> None:
        """Record what has come."""
        if not data:
            return
        self._heard_s = port.now()
        if self._echo.looking:
            echo, data = self._echo.take(data)
            self._holding = not echo and not data
        self._add(data, "drive", self._heard_s)

    def close(self) -> None:
        """End the recording."""
        self._let_go_of_echo()
        if self._path is not None and not self._over:
            # Also of a line on which nothing was said there is a file.
            self._try(self._recorder_now)
        self._over = True
        if self._writer is not None:
            self._writer.close()

    def _let_go_of_echo(self) -> None:
        """Record what looked like the beginning of an echo and never became one."""
        if self._holding:
            self._holding = False
            self._add(self._echo.give_up(), "drive", self._heard_s)

    def _add(self, data: bytes, source: Source, time_s: float) -> None:
        if self._over or not data:
            return
        # A file says in its header which are the usual ones; an object is told with each piece.
        usual = self._path is not None and self._settings == self._first
        settings = None if usual else self._settings
        piece = Piece(time_s=max(0.0, time_s - self._began_s), data=data, source=source, settings=settings)
        self._try(lambda: self._take(piece))

    def _take(self, piece: Piece) -> None:
        if self._path is None or self._clock is None:
            self._recorder_now().add(piece)
        else:
            self._gaps.write(lambda: self._write(piece), self._clock.wall_time())

    def _write(self, piece: Piece) -> None:
        try:
            self._recorder_now().add(piece)
        except FileFormatError as error:
            # What the operating system says may change; anything else will not.
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            raise

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - whatever it is, a motor must still be stopped
            self._over = True
            _LOGGER.warning("the recording has ended, the line goes on: %s", error)

    def _recorder_now(self) -> Recorder:
        if self._recorder is None:
            provenance = Provenance(
                began=self._began,
                tool=f"drivecomm {__version__}",
                port=self._name,
                settings=self._first,
                drives=tuple(sorted(self._drives())),
            )
            self._recorder = self._writer = CaptureWriter(self._path or "", provenance)
        return self._recorder


class RecordedPort(PortProxy):
    """A port that tells a recording what passes through it."""

    def __init__(self, port: Port, recording: Recording) -> None:
        super().__init__(port)
        self._recording = recording

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings."""
        note = self._port.configure(settings)
        self._recording.configured(settings)
        return note

    def write(self, data: bytes) -> None:
        """Send."""
        self._port.write(data)
        self._recording.sent(data, self._port)

    def read(self, until: float, at_least: int) -> bytes:
        """Return what comes."""
        data = self._port.read(until, at_least)
        self._recording.received(data, self._port)
        return data

    def take(self) -> bytes:
        """Return what is there."""
        data = self._port.take()
        self._recording.received(data, self._port)
        return data
