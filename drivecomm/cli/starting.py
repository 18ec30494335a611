"""Starting from the command line: no motor turns without somebody having said what stops it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, get_args

from drivecomm.bus import keep, policies
from drivecomm.cli.output import complain, emit, say
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.start_door import door_of_start
from drivecomm.errors import DriveCommError, DriveError, UsageError, near
from drivecomm.protocol import LinkLoss

if TYPE_CHECKING:
    from collections.abc import Callable
    from threading import Event

    from drivecomm.bus import Drive
    from drivecomm.cli.drive_names import DriveName
    from drivecomm.protocol import DriveStatus, Stop


def chosen_policy(drive: Drive, text: str | None) -> LinkLoss:
    """Return the policy that was asked for. Raises UsageError with what to write where none was, or none that is."""
    if text is None:
        raise UsageError(
            f"no motor is started without saying what it does when this line falls silent; write {_choice(drive)}"
        )
    for policy in get_args(LinkLoss):
        if text.lower() == policy:
            found: LinkLoss = policy
            return found
    question = near(text, get_args(LinkLoss))
    known = f"{question} Write" if question else "write"
    raise UsageError(f"{text!r} is nothing that a motor does when a line falls silent; {known} {_choice(drive)}")


def start_and_leave(drive: Drive, name: DriveName, start: Callable[[], None], *, as_json: bool) -> None:
    """Start a motor that nobody watches from here; its own watchdog, where its model knows one, must be off.

    Whoever interrupts this before it says that the motor was started does not want it to turn: it is stopped again.
    """
    with until_stopped() as stop:
        with keep(drive, "hold") as kept:
            if stop.is_set():
                raise KeyboardInterrupt
            try:
                start()
            finally:
                if stop.is_set():
                    _stop_again(drive, name, as_json=as_json)
                    raise KeyboardInterrupt
        if as_json:
            emit(**name.keys, done="started", link_loss="hold", watchdog_s=None)
            return
        say(f"{name.name}  started, and goes on without this program")
        if kept.watchdog is None:
            why = "no model is named" if drive.model is None else f"the model {drive.model.name} knows no watchdog"
            say(f"  its own watchdog was not looked at, because {why}; {drive.capabilities.link_loss}")


def _stop_again(drive: Drive, name: DriveName, *, as_json: bool) -> None:
    try:
        drive.stop()
    except DriveCommError as error:
        complain(f"{name.name} may be running, because its stop is not confirmed: {error}", as_json=as_json)
    else:
        complain(f"{name.name} was told to stop, because its start was interrupted", as_json=as_json)


def start_and_stay(
    drive: Drive,
    name: DriveName,
    start: Callable[[], None],
    policy: LinkLoss,
    watchdog_s: str,
    *,
    port: str,
    as_json: bool,
) -> int:
    """Start a motor and keep it in hand until Ctrl-C or a signal like it, or until it has a fault; return the code.

    A stop from another program ends it, too, and other drives of its line are stopped for it.
    """
    with until_stopped() as stop:
        watch = _Watch(name, stop, as_json=as_json)
        kept = keep(drive, policy, watchdog_s=watchdog_s, on_failure=watch.failed, on_status=watch.answered)

        def leave(how: Stop) -> None:
            kept.stop_by(how)
            stop.set()

        with door_of_start(drive, port, leave, as_json=as_json) as asked, kept:
            watch.tell(done="watchdog set", text=f"watchdog: {kept.watchdog} without this program")
            if not (stop.is_set() or asked.is_set()):
                start()
            watch.tell(
                done="started",
                text="started; Ctrl-C stops it and sets the watchdog as it was",
                link_loss=policy,
                watchdog_s=watchdog_s,
            )
            kept.until(stop)
        watch.tell(done="stop commanded", text="stop commanded; watchdog as it was")
    return DriveError.exit_code if watch.fault else 0


class _Watch:
    """Tells what happens to a drive that is kept in hand, each thing once."""

    def __init__(self, name: DriveName, stop: Event, *, as_json: bool) -> None:
        self._name = name
        self._stop = stop
        self._as_json = as_json
        self._failing = ""
        self.fault = False

    def tell(self, *, done: str, text: str, **further: object) -> None:
        """Say what has been done."""
        if self._as_json:
            emit(**self._name.keys, done=done, **further)
        else:
            say(f"{self._name.name}  {text}")

    def failed(self, error: DriveCommError) -> None:
        """Say that the drive could not be spoken to."""
        if str(error) != self._failing:
            self._failing = str(error)
            complain(error, as_json=self._as_json, where=time.strftime("%H:%M:%S"))

    def answered(self, status: DriveStatus) -> None:
        """Take note of how the drive is; a fault ends it."""
        if self._failing:
            self._failing = ""
            self.tell(done="answers again", text="answers again")
        if status.fault and not self.fault:
            self.fault = True
            fault = " ".join(str(part) for part in (status.fault_code, status.fault_text) if part)
            self.tell(done="fault", text=f"has a fault{f' ({fault})' if fault else ''}", fault_code=status.fault_code)
            self._stop.set()


def _choice(drive: Drive) -> str:
    """Return what can be written, in words."""
    known = policies(drive.model)
    watched = [f"--link-loss {policy}" for policy in known if policy != "hold"]
    if watched:
        return f"{' or '.join(watched)} (the drive's own watchdog, fed from here), or --link-loss hold (it goes on)"
    why = "with --model also what its own watchdog can" if drive.model is None else "its model knows no watchdog"
    return f"--link-loss hold (it goes on); {why}"
