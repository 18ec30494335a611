"""Lease of a server's drive, and a motor that the server keeps under this lease while its program lives."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from drivecomm.bus import lease_s, reading_watchdog, setting_watchdog, stop_motor
from drivecomm.client.wire import error_of, status_of
from drivecomm.errors import LeaseError, NotAnsweringError, NotSupported, ReadOnlyError, StateError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from decimal import Decimal

    from drivecomm.bus import Procedure, Setting
    from drivecomm.client.served_drive import RemoteDriveBase
    from drivecomm.protocol import DriveStatus, LinkLoss, Stop

# Time for a stop with all its attempts, and for the watchdog's parameters.
END_S = 20.0
_VALID_S = 10


class DriveLease:
    """Renewable right to command a drive of a server for some seconds; its requests run in the caller's thread.

    silence_s: longest silence of this program in seconds, within the limits of leases.
    """

    def __init__(self, drive: RemoteDriveBase, silence_s: Decimal | float) -> None:
        self._drive = drive
        self.seconds = lease_s(silence_s)
        self.key = ""

    def acquire(self) -> None:
        """Acquire the lease. Raises LeaseError while another program holds it."""
        taken = self._drive.server.order(f"{self._drive.place}/lease", {"seconds": self.seconds})
        self.key = str(taken["key"])

    def renew(self) -> None:
        """Renew the lease for its full time. Raises LeaseError if it has expired."""
        asked = {"key": self.key, "seconds": self.seconds}
        self._drive.server.order(f"{self._drive.place}/lease", asked, method="PUT", limit_s=self.seconds)

    def release(self) -> None:
        """Release the lease; the server then applies the policy of a motor kept under it. Raises LeaseError."""
        self._drive.server.order(f"{self._drive.place}/lease", {"key": self.key}, method="DELETE", limit_s=END_S)

    def keep(self, policy: LinkLoss, watchdog_s: Decimal | float, **choices: Any) -> None:
        """Let the server set the drive's watchdog and feed it while the lease is renewed.

        choices: options for starting the motor at the server; start=False does not start it. Raises the error that
        prevents it.
        """
        asked = {
            **self._drive.request({}),
            "id": os.urandom(8).hex(),
            "lease": self.key,
            "policy": policy,
            "watchdog_s": watchdog_s,
            "issued_s": time.time(),
            "valid_s": _VALID_S,
            **{name: value for name, value in choices.items() if value is not None},
        }
        del asked["arguments"]
        answer = self._drive.server.order(f"{self._drive.place}/keep", asked)
        if answer.get("error"):
            raise self._drive.own_error(error_of(answer["error"]))


class LeaseFeeding:
    """Lease that keeps a motor: the server feeds its watchdog while this program renews the lease.

    If the program dies, the lease expires; the server then applies the policy to the motor and stops feeding.
    """

    def __init__(self, drive: RemoteDriveBase, policy: LinkLoss, watchdog_s: Decimal, on_leaving: Stop | None) -> None:
        if drive.read_only_reason:
            raise ReadOnlyError(drive.read_only_reason)
        if not drive.is_in_plant:
            raise UsageError(
                f"{drive.name} is not in the plant of {drive.server.registration}, which keeps only drives of its "
                "plant; add it to that plant file"
            )
        if on_leaving is None:
            raise NotSupported(
                f"{drive.name} is kept by {drive.server.registration}, which stops it when it is released; leave "
                "on_leaving out, or open the plant with own_ports=True",
                says="own_ports=True",
            )
        self._drive, self._policy, self._watchdog_s = drive, policy, watchdog_s
        self._lease = DriveLease(drive, watchdog_s)
        self._has_ended = False
        self.silence_s = self._lease.seconds
        self.setting: Setting | None = None

    def taking(self) -> Procedure[None]:
        """Acquire the lease, and let the server set the drive's watchdog and feed it."""
        drive, lease = self._drive, self._lease
        # Invalid settings raise an error here, before anything is sent.
        setting_watchdog(drive.name, drive.model, self._policy, self._watchdog_s).close()
        yield _at_server(lease.acquire)
        drive.lease = lease.key
        try:
            yield _at_server(lambda: lease.keep(self._policy, self._watchdog_s, start=False))
            self.setting = yield from reading_watchdog(drive.name, drive.model)
        except Exception:
            drive.lease = ""
            with suppress(Exception):
                yield _at_server(lease.release)
            raise
        except BaseException:
            # The lease expires by itself.
            drive.lease = ""
            raise

    def refreshing(self) -> Procedure[DriveStatus]:
        """Renew the lease, and return the server's latest status of the drive; never waits for the line."""
        drive = self._drive
        try:
            yield _at_server(self._lease.renew)
        except LeaseError as error:
            self._has_ended = True
            raise LeaseError(
                f"{drive.name} is no longer kept, because another program has stopped it, or its lease was not "
                "renewed in time; start it again in a new block"
            ) from error
        state = yield _at_server(lambda: drive.server.ask(drive.place))
        if state["reachability"] == "silent" or state["status"] is None:
            raise NotAnsweringError(f"{drive.name} does not answer its server: {state['error']}")
        return status_of(state["status"])

    def stopping(self, how: Stop | None) -> Procedure[None]:
        """Stop the motor once; the server then releases it. Sends nothing for a motor that is no longer kept."""
        # A stop under the lease would not end the keeping of the motor.
        self._drive.lease = ""
        if how is not None and not self._has_ended:
            yield stop_motor(how)

    def restoring(self) -> Procedure[None]:
        """Wait until the server has restored the drive's watchdog."""
        if not self._has_ended:
            yield _at_server(self._released)

    def _released(self) -> None:
        with suppress(LeaseError):
            # The stop has already ended the lease.
            self._lease.release()
        until = time.monotonic() + END_S
        with self._drive.server.stream(f"{self._drive.place}/keep/events") as news:
            for each in news:
                if each is not None and each["done"] == "failed":
                    raise error_of(each["error"]) if "error" in each else StateError(str(each["text"]))
                if time.monotonic() > until:
                    raise StateError(f"{self._drive.name} is stopped, but its watchdog is not restored yet")


def _at_server(do: Callable[[], Any]) -> Callable[[Any], Any]:
    return lambda drive: drive.at_server(do)
