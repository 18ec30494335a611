"""What is done with a drive before its master is told to do a task."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.judge.drive import JudgedDrive
    from drivecomm.judge.trial import Trial


def prepared(trial: Trial, drive: JudgedDrive) -> None:
    """Let the motor run that is to be stopped, and trip the drive that is to be reset; give others a reference."""
    task = trial.task.name
    if task == "stop":
        trial.known.set_running(drive)
    elif task == "reset":
        trial.known.set_tripped(drive)
    elif task == "start":
        trial.known.set_ready(drive)
