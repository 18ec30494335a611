"""A motor that a server keeps running for a client: for as long as the client renews its lease, and not longer."""

from __future__ import annotations

import os
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Self

from drivecomm.client.wire import error_of
from drivecomm.errors import DriveCommError, LinkError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.client.served_bus import ServedDrive

LONGEST_LEASE_S = 30.0
SHORTEST_LEASE_S = 2.0
_RENEWALS = 3
# To end: a stop with all its attempts, and the watchdog's parameters.
_END_S = 20.0
_VALID_S = 10


class KeptMotor:
    """Takes the lease of a drive for the time of a block, and renews it in a thread; leaving gives it back.

    When it is given back, or runs out because this program has died, the server does what the policy says. silence_s:
    for how long this program may say nothing, as far as leases allow it.
    """

    def __init__(self, drive: ServedDrive, silence_s: float) -> None:
        self._server = drive.server
        self._place = drive.place
        self._drive = drive
        self._seconds = min(LONGEST_LEASE_S, max(SHORTEST_LEASE_S, silence_s))
        self._key = ""
        self._left = Event()
        self._thread = Thread(target=self._renew, name=f"lease of {drive.name}", daemon=True)

    def start(self, policy: str, **choices: Any) -> None:
        """Have the server set the drive's watchdog, start the motor and keep it; raises what prevents it."""
        asked = {
            **self._drive.request({}),
            "id": os.urandom(8).hex(),
            "lease": self._key,
            "policy": policy,
            "issued_s": time.time(),
            "valid_s": _VALID_S,
            **{name: value for name, value in choices.items() if value is not None},
        }
        del asked["arguments"]
        answer = self._server.order(f"{self._place}/keep", asked)
        if answer.get("error"):
            raise self._drive.own_error(error_of(answer["error"]))

    def events(self, stop: Event) -> Iterator[Mapping[str, Any]]:
        """Yield what happens to the motor until the server keeps it no more; stop: ends that, once it is set."""
        with self._server.stream(f"{self._place}/keep/events") as news:
            for each in news:
                if each is not None:
                    yield each
                if stop.is_set() and not self._left.is_set():
                    self.give_back()

    def give_back(self) -> None:
        """Give the lease back, so that the server stops the motor as its policy says."""
        self._left.set()
        self._server.order(f"{self._place}/lease", {"key": self._key}, method="DELETE", limit_s=_END_S)

    def __enter__(self) -> Self:
        taken = self._server.order(f"{self._place}/lease", {"seconds": self._seconds})
        self._key = str(taken["key"])
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if self._left.is_set():
            return
        try:
            self.give_back()
        except DriveCommError:
            # A motor that was stopped by somebody else has no lease any more; any other error goes first.
            self._left.set()

    def _renew(self) -> None:
        while not self._left.wait(self._seconds / _RENEWALS):
            try:
                asked = {"key": self._key, "seconds": self._seconds}
                self._server.order(f"{self._place}/lease", asked, method="PUT", limit_s=self._seconds)
            except LinkError:
                # Tried again; whoever reads the events is told.
                continue
            except DriveCommError:
                return
