"""Preparation of a drive before its master gets a task."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.judge.judged_drive import JudgedDrive
    from drivecomm.judge.trial import CaseContext


def prepare_drive(trial: CaseContext, drive: JudgedDrive) -> None:
    """Prepare the drive for the task: run the motor to be stopped, trip the drive to be reset, or set a reference."""
    task = trial.task.name
    if task == "stop":
        trial.known.set_running(drive)
    elif task == "reset":
        trial.known.set_tripped(drive)
    elif task == "start":
        trial.known.set_ready(drive)
