"""Recording of the lines of a served plant, as a capture file that `sniff` and `replay` read."""

from __future__ import annotations

import logging
import time
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Self

from drivecomm.capture import CaptureWriter, Piece, Provenance, WriteGaps
from drivecomm.errors import FileFormatError
from drivecomm.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.protocol import LineSettings
    from drivecomm.virtual.medium import Transmission
    from drivecomm.virtual.virtual_plant import VirtualPlant

_LOGGER = logging.getLogger("drivecomm.capture")


class PlantRecord:
    """A capture of all lines of a plant, as a context manager. An existing file is replaced.

    Enter it when the clocks of the lines start. A full disk does not stop the server: missing pieces are logged to
    `drivecomm.capture`. Raises UsageError and FileFormatError if the file cannot be written.
    """

    def __init__(self, plant: VirtualPlant, path: Path) -> None:
        self._plant = plant
        self._path = path
        self._gaps = WriteGaps(str(path), kept="pieces", done="recorded", goes_on="serving", tell=_LOGGER.warning)
        self._settings: LineSettings | None = None
        self._writer: CaptureWriter | None = None

    def __enter__(self) -> Self:
        plant = self._plant.plant
        known = {drive.settings for drive in self._plant.drives.values()}
        self._settings = known.pop() if len(known) == 1 else None
        provenance = Provenance(
            began=datetime.now(UTC),
            tool=f"drivecomm {__version__}",
            port=", ".join(line.listen for line in plant.lines),
            settings=self._settings,
            drives=tuple(sorted({str(drive) for drive in plant.drives})),
            note="virtual drives",
        )
        self._writer = CaptureWriter(self._path, provenance)
        several = len(self._plant.lines) > 1
        for name, line in self._plant.lines.items():
            line.recorders.append(partial(self._add, name if several else ""))
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._gaps.missing:
            _LOGGER.warning("%s", self._gaps.summary)

    def _add(self, line: str, sent: Transmission) -> None:
        # A master without known settings counts as using those of each drive.
        settings = None if sent.agreed or sent.settings == self._settings else sent.settings
        source = sent.source if sent.source in ("master", "drive") else "unknown"
        piece = Piece(time_s=sent.ended, data=sent.data, source=source, line=line, settings=settings)
        if self._writer is not None:
            self._gaps.write(partial(self._write, self._writer, piece), time.time())

    def _write(self, writer: CaptureWriter, piece: Piece) -> None:
        try:
            writer.add(piece)
        except FileFormatError as error:
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            raise
