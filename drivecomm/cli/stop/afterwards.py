"""Whether a drive is of the model by which it was stopped; asked afterwards, so that no stop waits.

What stops one series starts another (1 is the stop of Delta and the forward run of INVT: MS300 manual p. 789,
Goodrive350 manual p. 317).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import Bus
from drivecomm.errors import DriveCommError, WrongDriveError
from drivecomm.line import Job, Rank

if TYPE_CHECKING:
    from drivecomm.bus import BlockingLine, Drive


def check_right_drive(bus: BlockingLine, drive: Drive) -> None:
    """Raise WrongDriveError where something speaks against the model; what cannot be found out is no matter now."""
    check = drive.peer.check_series
    if check is None or not isinstance(bus, Bus):
        return
    try:
        bus.run(Job(drive.peer, check(), Rank.READ))
    except WrongDriveError as error:
        if not error.found:
            return
        raise WrongDriveError(
            f"{drive.name} was sent the stop of model {error.model}, and is not a drive of that model, or not set up "
            f"as one: {error.found}; look whether its motor stands",
            model=error.model,
            found=error.found,
            candidates=error.candidates,
        ) from error
    except DriveCommError:
        return
