"""Trial of start, reference, stop and link loss on a motor with the user's consent; always ends with a stop."""

from __future__ import annotations

from contextlib import suppress
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.bus import (
    USUAL_WATCHDOG_S,
    carry_out,
    keep,
    policies,
    read_watchdog,
    restoring_watchdog,
    set_watchdog,
)
from drivecomm.errors import DriveCommError, StateError, in_one_line
from drivecomm.protocol import DriveState
from drivecomm.proving.findings import ProofFinding
from drivecomm.proving.link_loss import watchdog_facts
from drivecomm.proving.parameters import model_facts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import Drive
    from drivecomm.protocol import DriveStatus, LinkLoss, Model
    from drivecomm.proving.proving import Proving

SPEED_HZ, SPEED_PERCENT = 5, 10
"""Reference of the trial: slow, but clearly not 0."""

_RUNS_WITHIN_S, _STANDS_WITHIN_S = 10.0, 60.0
_LOOKED_S = 0.1
_STOP_TRIES = 5
_TOLERANCE_HZ = Decimal(1)
_MARGIN_S = 3.0


class Moving:
    """The part of a proof that moves the motor. drive: a drive that may be commanded.

    cancelled: polled; if it returns True, the motor is stopped and KeyboardInterrupt raised.
    """

    def __init__(self, proving: Proving, drive: Drive, model: Model, cancelled: Callable[[], bool]) -> None:
        self._proving, self._drive, self._model = proving, drive, model
        self._cancelled = cancelled
        self.is_stopped = True
        """Whether the motor was not started, or its last stop was confirmed."""

    def run(self) -> None:
        """Run all steps; a failed step is a finding. Raises ReplyError if the stop at the end is not confirmed."""
        drive, proving = self._drive, self._proving
        proving.at = "the motor, before its start"
        status = drive.status()
        if drive.capabilities.monitoring_only or status.running or status.fault:
            why = (
                "the motor runs already" if status.running else "the drive has a fault" if status.fault else "no orders"
            )
            self._add(ProofFinding(kind="motion", verdict="not asked", about="start, reference and stop", why=why))
            proving.at = ""
            return
        try:
            self._commands()
            self._link_loss()
        finally:
            self._stop_at_last()
        proving.at = ""
        proving.on_section()

    def _commands(self) -> None:
        drive = self._drive
        self._begin("start, reference and stop")
        known = [each for each in policies(self._model) if each != "hold"]
        about = "start, and stop down the ramp"
        try:
            with keep(drive, known[0] if known else "hold") as kept:
                said = self._running()
                if known:
                    kept.sleep(0.0)
                drive.stop()
                self._until(lambda status: not status.running, _STANDS_WITHIN_S, "stand")
        except DriveCommError as error:
            why = f"{in_one_line(error)}; an open enable input does that, too"
            self._add(ProofFinding(kind="motion", verdict="contradicts", about=about, why=why))
            return
        self._add(ProofFinding(kind="motion", verdict="agrees", about=about, drive=said))
        self._add(*self._speed(said))

    def _begin(self, part: str) -> None:
        self._proving.at = part
        self._proving.progress(part, 0, 1)

    def _running(self) -> dict[str, Any]:
        """Start the motor slowly; return the reference and the output frequency it then shows."""
        drive = self._drive
        by_hz = drive.capabilities.reference_hz
        try:
            if by_hz:
                drive.set_reference(hz=SPEED_HZ)
            elif drive.capabilities.reference_percent:
                drive.set_reference(percent=SPEED_PERCENT)
        except DriveCommError:
            by_hz = False
            drive.set_reference(percent=SPEED_PERCENT)
        self.is_stopped = False
        drive.start()
        self._until(lambda status: status.running, _RUNS_WITHIN_S, "run")
        with suppress(StateError):
            self._until(lambda status: bool(status.at_reference), _RUNS_WITHIN_S, "reach its reference")
        said: dict[str, Any] = {"reference": f"{SPEED_HZ} Hz"} if by_hz else {"reference": f"{SPEED_PERCENT} %"}
        if "output_frequency" in self._model.quantities:
            said["output_frequency"] = drive.read("output_frequency").value
        return said

    def _speed(self, said: dict[str, Any]) -> Iterator[ProofFinding]:
        shown = said.get("output_frequency")
        if shown is None or said["reference"] != f"{SPEED_HZ} Hz":
            return
        about, address = "the output frequency while it runs", self._model.quantities["output_frequency"]
        info = self._model.parameters.get(address)
        fact: dict[str, Any] = {
            "model": {} if info is None else model_facts(info),
            "addresses": (address,),
            "drive": said,
        }
        if abs(Decimal(shown) - SPEED_HZ) <= _TOLERANCE_HZ:
            yield ProofFinding(kind="motion", verdict="agrees", about=about, shows=("scale",), **fact)
        else:
            why = f"it shows {shown} Hz with a reference of {SPEED_HZ} Hz"
            yield ProofFinding(kind="motion", verdict="contradicts", about=about, why=why, **fact)

    def _link_loss(self) -> None:
        drive = self._drive
        self._begin("the link loss")
        about = "what the motor does when its master falls silent"
        policy = next((each for each in policies(self._model) if each != "hold"), None)
        if policy is None or self._model.watchdog is None:
            why = "the model has no watchdog that stops a motor"
            self._add(ProofFinding(kind="motion", verdict="not asked", about=about, why=why))
            return
        places = tuple(each for each in (self._model.watchdog.time, self._model.watchdog.action) if each)
        try:
            earlier = read_watchdog(drive)
            # Some drives count from their last command, and would react immediately if that was long ago.
            drive.stop()
            try:
                set_watchdog(drive, policy, USUAL_WATCHDOG_S)
                self._running()
                self._pass(float(USUAL_WATCHDOG_S) + _MARGIN_S)
                found = drive.status()
                against = self._against(policy, found)
            finally:
                self._stop_at_last()
                self._acknowledge()
                carry_out(drive, restoring_watchdog(drive.name, drive.model, earlier))
        except DriveCommError as error:
            self._add(
                ProofFinding(
                    kind="link loss",
                    verdict="contradicts",
                    about=about,
                    addresses=places,
                    model=watchdog_facts(self._model),
                    why=in_one_line(error),
                )
            )
            return
        said = {"policy": policy, "after_s": USUAL_WATCHDOG_S, "then": found.state.value}
        said |= {} if found.fault_code is None else {"fault": found.fault_code}
        self._add(
            ProofFinding(
                kind="link loss",
                verdict="contradicts" if against else "agrees",
                about=about,
                addresses=places,
                model=watchdog_facts(self._model),
                drive=said,
                shows=() if against else ("setting",),
                why=against,
            )
        )

    def _against(self, policy: LinkLoss, status: DriveStatus) -> str:
        code = self._model.watchdog.fault if self._model.watchdog else None
        if status.state is DriveState.RUNNING:
            return f"it runs on for {_MARGIN_S:g} s longer than the {USUAL_WATCHDOG_S} s that its watchdog waits"
        if policy == "trip" and not status.fault:
            return "it stopped, and has no fault"
        if policy == "trip" and None not in (code, status.fault_code) and status.fault_code != code:
            return f"it tripped with fault {status.fault_code}, and the model has {code} for that"
        return ""

    def _until(self, met: Callable[[DriveStatus], bool], seconds: float, what: str) -> None:
        end = self._drive.bus.now() + seconds
        while not met(self._drive.status()):
            if self._drive.bus.now() >= end:
                raise StateError(f"the motor did not {what} within {seconds:g} s")
            self._pass(_LOOKED_S)

    def _pass(self, seconds: float) -> None:
        """Wait without sending a telegram. Raises KeyboardInterrupt if the user cancels."""
        end = self._drive.bus.now() + seconds
        while (now := self._drive.bus.now()) < end:
            if self._cancelled():
                raise KeyboardInterrupt
            self._drive.bus.sleep_until(min(end, now + _LOOKED_S))
        if self._cancelled():
            raise KeyboardInterrupt

    def _stop_at_last(self) -> None:
        """Stop the motor, and retry until the stop is confirmed. Raises ReplyError if it never is."""
        for left in reversed(range(_STOP_TRIES)):
            try:
                self._drive.stop()
            except DriveCommError:
                if not left:
                    raise
            else:
                self.is_stopped = True
                return

    def _acknowledge(self) -> None:
        with suppress(DriveCommError):
            self._until(lambda status: not status.running, _STANDS_WITHIN_S, "stand")
            if self._drive.status().fault:
                self._drive.reset()

    def _add(self, *findings: ProofFinding) -> None:
        self._proving.findings += findings
        self._proving.on_section()
