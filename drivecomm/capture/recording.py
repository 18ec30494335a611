"""Recording of a bus through a wrapper around its port: nothing is lost, and it costs nothing when off.

    with drivecomm.open_bus("/dev/ttyUSB0", record="pumps.jsonl") as bus:
        ...

The time of a sent piece is that of its last character on the wire, computed from the line settings. The time of a
received piece is that of its fetching from the port: bytes between exchanges are fetched by the next exchange. An
expected echo repeats the master's own bytes and is not recorded again.
"""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from drivecomm.capture.files import CaptureWriter, check_place
from drivecomm.capture.growing_file import WriteGaps
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


class PieceReceiver(Protocol):
    """Receiver of the pieces of a recording."""

    def add(self, piece: Piece) -> None:
        """Add a piece."""
        ...


Record: TypeAlias = str | Path | PieceReceiver
"""Destination of a recording: a file name ending in .jsonl or .pcapng, or any object with `add(piece)`."""


class Recording:
    """Recording of one bus, across reconnections of its port.

    open_port: opens the port. record: destination of the pieces; an object gets the line settings with each of them.
    name: name of the port. echo: echo handling of the bus. drives: returns the known drives on the line. Raises
    UsageError for an invalid file, before anything is sent.
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
        self._recorder: PieceReceiver | None = None if isinstance(record, str | Path) else record
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
        self._gaps = WriteGaps(str(record), kept="pieces", done="recorded", goes_on="the line", tell=tell)
        self._first: LineSettings | None = None
        self._settings: LineSettings | None = None
        self._over = False
        if self._path is not None:
            check_place(self._path)

    def open_port(self) -> Port:
        """Open the port, or reopen it, and return it with recording."""
        port = self._open_port()
        if self._clock is None:
            self._began_s = self._busy_until_s = port.now()
            # A virtual line has no time of day.
            self._began = datetime.fromtimestamp(port.wall_time(), UTC) if port.real_time else None
        self._clock = port
        return RecordedPort(port, self)

    def configured(self, settings: LineSettings) -> None:
        """Set the line settings of the following pieces."""
        self._settings = settings
        self._first = self._first or settings

    def sent(self, data: bytes, port: Port) -> None:
        """Record bytes passed on for sending."""
        self._let_go_of_echo()
        if self._echo.looking:
            self._echo.sent(data)
        now = port.now()
        if port.paced and self._settings is not None:
            now = max(now, self._busy_until_s) + self._settings.wire_s(len(data))
            self._busy_until_s = now
        self._add(data, "master", now)

    def received(self, data: bytes, port: Port) -> None:
        """Record received bytes."""
        if not data:
            return
        self._heard_s = port.now()
        if self._echo.looking:
            echo, data = self._echo.take(data)
            self._holding = not echo and not data
        self._add(data, "drive", self._heard_s)

    def close(self) -> None:
        """End the recording and close its file."""
        self._let_go_of_echo()
        if self._path is not None and not self._over:
            # Creates the file even if nothing was recorded.
            self._try(self._recorder_now)
        self._over = True
        if self._writer is not None:
            self._writer.close()

    def _let_go_of_echo(self) -> None:
        """Record bytes that looked like the beginning of an echo but are none."""
        if self._holding:
            self._holding = False
            self._add(self._echo.give_up(), "drive", self._heard_s)

    def _add(self, data: bytes, source: Source, time_s: float) -> None:
        if self._over or not data:
            return
        # A file has the usual settings in its header; an object gets them with each piece.
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
            # Errors of the operating system may be temporary; others are not.
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            raise

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - whatever it is, a motor must still be stopped
            self._over = True
            _LOGGER.warning("the recording has stopped, the line continues: %s", error)

    def _recorder_now(self) -> PieceReceiver:
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
    """Port that passes everything sent and received on to a recording."""

    def __init__(self, port: Port, recording: Recording) -> None:
        super().__init__(port)
        self._recording = recording

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings."""
        note = self._port.configure(settings)
        self._recording.configured(settings)
        return note

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._port.write(data)
        self._recording.sent(data, self._port)

    def read(self, until: float, at_least: int) -> bytes:
        """Return the received bytes once there are `at_least` bytes, or at `until` whatever has arrived."""
        data = self._port.read(until, at_least)
        self._recording.received(data, self._port)
        return data

    def take(self) -> bytes:
        """Return the received bytes without waiting."""
        data = self._port.take()
        self._recording.received(data, self._port)
        return data
