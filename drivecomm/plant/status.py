"""Status of every drive of a plant, read from all lines concurrently.

Each line has its own thread, so that a silent drive delays only its own line, and only for the attempts of its
protocol.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from threading import Thread
from time import monotonic
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, DriveError, LinkError, ReplyError, UsageError

if TYPE_CHECKING:
    from drivecomm.bus import Drive
    from drivecomm.plant.opened import OpenPlant
    from drivecomm.protocol import DriveConfig, DriveStatus, MachineValue, Reading

OUTPUT = "output_frequency"
CURRENT = "output_current"
REFERENCES = ("reference_frequency", "reference_percent")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveReport:
    """Values that one drive reported for the status of its plant.

    status: None if the drive did not answer; error is the reason then. output_hz, current_a, reference: None unless the
    drive's model maps such a value or its status contains it. asked_at: time of the request on the clock
    `time.monotonic`, in seconds. standing_stop: stop of the drive that its server retries, or that is demanded there,
    in words; empty without one.
    """

    drive: DriveConfig
    status: DriveStatus | None = None
    output_hz: Decimal | None = None
    current_a: Decimal | None = None
    reference: Reading | None = None
    error: DriveCommError | None = None
    asked_at: float = 0.0
    standing_stop: str = ""

    @property
    def output_machine(self) -> MachineValue | None:
        """Output in machine units; None if the plant does not define the unit, or the output is unknown."""
        machine = self.drive.machine
        return None if machine is None or self.output_hz is None else machine.shown(self.output_hz)

    @property
    def reference_machine(self) -> MachineValue | None:
        """Reference in machine units; None as in `output_machine`."""
        machine = self.drive.machine
        return None if machine is None or self.reference is None else machine.beside(self.reference)

    @property
    def exit_code(self) -> int:
        """Exit code of a command for this drive alone: 0 for an answer without a fault."""
        if self.error is not None:
            return self.error.exit_code
        return DriveError.exit_code if self.status is not None and self.status.fault else 0


def plant_status(opened: OpenPlant) -> list[DriveReport]:
    """Read status, output, current and reference of all drives of a plant; commands nothing.

    The reports are in the order of the plant. The report of a drive that does not answer contains the error.
    """
    reports: dict[str, DriveReport] = {}
    failures: list[BaseException] = []

    def ask_line(drives: tuple[DriveConfig, ...]) -> None:
        try:
            gone: LinkError | None = None
            for drive in drives:
                report = DriveReport(drive=drive, error=gone, asked_at=monotonic()) if gone else _report(opened, drive)
                if isinstance(report.error, LinkError):
                    # No drive on a dead line can answer, and each attempt would fail after the same wait.
                    gone = report.error
                reports[drive.name] = report
        except BaseException as error:  # noqa: BLE001 - raised again by the waiting thread
            failures.append(error)

    threads = [
        Thread(target=ask_line, args=(opened.plant.on_line(line.name),), daemon=True) for line in opened.plant.lines
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
    return [reports[drive.name] for drive in opened.plant.drives]


def _report(opened: OpenPlant, planned: DriveConfig) -> DriveReport:
    try:
        drive = opened.drive(planned.name)
    except DriveCommError as error:
        return DriveReport(drive=planned, error=error, asked_at=monotonic())
    stop = _standing_stop(drive)
    try:
        status = drive.status()
    except DriveCommError as error:
        return DriveReport(drive=planned, error=error, asked_at=monotonic(), standing_stop=stop)
    asked_at = monotonic()
    output = _number(_quantity(drive, OUTPUT))
    readings = (_quantity(drive, name) for name in REFERENCES)
    return DriveReport(
        drive=planned,
        status=status,
        output_hz=status.actual_hz if output is None else output,
        current_a=_number(_quantity(drive, CURRENT)),
        reference=next((reading for reading in readings if reading is not None), None),
        asked_at=asked_at,
        standing_stop=stop,
    )


def _standing_stop(drive: Drive) -> str:
    # Only a server has standing stops; the request to the drive reports a lost server.
    with suppress(DriveCommError):
        return getattr(drive, "standing_stop", "")
    return ""


def _quantity(drive: Drive, name: str) -> Reading | None:
    """Read a common name; None if the drive's model does not map it, or the drive does not report it."""
    if drive.model is None or name not in drive.model.quantities:
        return None
    try:
        return drive.read(name)
    except (ReplyError, DriveError, UsageError):
        # The status arrived, so a missing value only stays empty.
        return None


def _number(reading: Reading | None) -> Decimal | None:
    return None if reading is None or isinstance(reading.value, str) else Decimal(reading.value)
