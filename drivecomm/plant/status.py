"""How a whole plant is: the status of every drive, all lines at the same time.

A line has a thread of its own, so that a drive that does not answer holds up its own line only, and that no longer than
its protocol's attempts take.
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
    """What one drive told when the plant was asked.

    status: None where it told nothing; error says why then. output_hz, current_a, reference: where the drive's model
    knows such a quantity, or its status says it. asked_at: on the clock of `time.monotonic`, in seconds. standing_stop:
    the stop of it that its server retries, or that is demanded there, in words; empty without one.
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
        """The output at the machine; None where the plant does not say its unit, or the output is not known."""
        machine = self.drive.machine
        return None if machine is None or self.output_hz is None else machine.shown(self.output_hz)

    @property
    def reference_machine(self) -> MachineValue | None:
        """The reference at the machine, as `output_machine`."""
        machine = self.drive.machine
        return None if machine is None or self.reference is None else machine.beside(self.reference)

    @property
    def exit_code(self) -> int:
        """What this drive means for the exit code of a command: 0 when all is well."""
        if self.error is not None:
            return self.error.exit_code
        return DriveError.exit_code if self.status is not None and self.status.fault else 0


def plant_status(opened: OpenPlant) -> list[DriveReport]:
    """Ask all drives of a plant for status, output, current and reference; commands nothing.

    The reports are in the order of the plant. A drive that does not answer has a report that says so.
    """
    reports: dict[str, DriveReport] = {}
    failures: list[BaseException] = []

    def ask_line(drives: tuple[DriveConfig, ...]) -> None:
        try:
            gone: LinkError | None = None
            for drive in drives:
                report = DriveReport(drive=drive, error=gone, asked_at=monotonic()) if gone else _report(opened, drive)
                if isinstance(report.error, LinkError):
                    # Nobody on it can be asked, and each would say the same after the same time.
                    gone = report.error
                reports[drive.name] = report
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits, which raises it
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
    # Only a server has any, and one that has gone is reported by what asks the drive.
    with suppress(DriveCommError):
        return getattr(drive, "standing_stop", "")
    return ""


def _quantity(drive: Drive, name: str) -> Reading | None:
    """Read a common name; None where the drive's model has none, or the drive does not tell it."""
    if drive.model is None or name not in drive.model.quantities:
        return None
    try:
        return drive.read(name)
    except (ReplyError, DriveError, UsageError):
        # Its status came; a value that did not is left open.
        return None


def _number(reading: Reading | None) -> Decimal | None:
    return None if reading is None or isinstance(reading.value, str) else Decimal(reading.value)
