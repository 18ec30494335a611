"""Motor that a server starts and keeps for a command, only as long as the command renews its lease."""

from __future__ import annotations

from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Self

from drivecomm.bus import REFRESHES_IN_TIME
from drivecomm.client.drive_lease import DriveLease
from drivecomm.errors import DriveCommError, LinkError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from decimal import Decimal

    from drivecomm.client.served_bus import ServedDrive
    from drivecomm.protocol import LinkLoss


class ServedStart:
    """Lease of a drive for the time of a block, with the server's events of its motor.

    For commands that display these events; other programs use `drivecomm.keep`.
    """

    def __init__(self, drive: ServedDrive, silence_s: float) -> None:
        self._drive = drive
        self._lease = DriveLease(drive, silence_s)
        self._left = Event()
        self._thread = Thread(target=self._renew, name=f"lease of {drive.name}", daemon=True)

    def start(self, policy: LinkLoss, watchdog_s: Decimal | float, **choices: Any) -> None:
        """Let the server set the drive's watchdog, start the motor and keep it; raises the error that prevents it."""
        self._lease.keep(policy, watchdog_s, **choices)

    def events(self, stop: Event) -> Iterator[Mapping[str, Any]]:
        """Yield the events of the motor until the server no longer keeps it. stop: ends the keeping once it is set."""
        with self._drive.server.stream(f"{self._drive.place}/keep/events") as news:
            for each in news:
                if each is not None:
                    yield each
                if stop.is_set() and not self._left.is_set():
                    self.give_back()

    def give_back(self) -> None:
        """Release the lease, so that the server stops the motor by its policy."""
        self._left.set()
        self._lease.release()

    def __enter__(self) -> Self:
        self._lease.acquire()
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if self._left.is_set():
            return
        try:
            self.give_back()
        except DriveCommError:
            # A motor that another program stopped has no lease any more; any other error takes precedence.
            self._left.set()

    def _renew(self) -> None:
        while not self._left.wait(self._lease.seconds / REFRESHES_IN_TIME):
            try:
                self._lease.renew()
            except LinkError:
                # The renewal is retried; the reader of the events gets the error.
                continue
            except DriveCommError:
                return
