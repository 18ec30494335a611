"""The start command: no motor turns without somebody having said what stops it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from drivecomm.bus import carry_out, keep, policies, starting
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import number
from drivecomm.cli.options import Drive, Model
from drivecomm.cli.output import complain, labels, say, tell
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.start_watch import Watch
from drivecomm.errors import DriveCommError, DriveError, UsageError, near
from drivecomm.protocol import LinkLoss, Stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm import bus
    from drivecomm.cli.stops_from_others import StopsFromOthers
    from drivecomm.client import ServedDrive
    from drivecomm.protocol import DriveConfig


def start(
    drive: Drive,
    line: LineOptions,
    link_loss: Annotated[
        str | None,
        typer.Option(
            "--link-loss",
            metavar="POLICY",
            help="If communication is lost: hold, ramp, coast or trip. Default: as in the plant file.",
        ),
    ] = None,
    watchdog: Annotated[
        str | None,
        typer.Option("--watchdog", metavar="SECONDS", help="Timeout of the drive's watchdog. Default: 5."),
    ] = None,
    reverse: Annotated[bool, typer.Option("--reverse", help="Run in reverse.")] = False,
    percent: Annotated[str | None, typer.Option(help="Set the reference first, in percent.")] = None,
    hz: Annotated[str | None, typer.Option(help="Set the reference first, in hertz.")] = None,
    model: Model = None,
) -> int:
    """Start the motor; --link-loss says what it does when communication is lost.

    With hold it keeps running, and the command ends. Otherwise the command sets the drive's own watchdog first, then
    stays and feeds it until Ctrl-C, which stops the motor. Exit code 5 when the drive has a fault meanwhile.
    """
    said = line.link_loss_of(drive)
    with line.drive(drive, model) as (one, name):
        if name.read_only_reason:
            # Said before its watchdog is looked at.
            raise UsageError(name.read_only_reason)
        policy = _chosen_policy(one, link_loss or (said.policy if said else None))
        # What the plant says of a watchdog belongs to the policy that it says.
        usual_s = f"{said.watchdog_s:g}" if said and policy == said.policy else "5"

        def run() -> None:
            carry_out(one, starting(reverse=reverse, percent=number(percent), hz=number(hz)))

        if policy != "hold" and line.reaching(drive)[0].server is not None:
            # Loaded by those who go through a server only.
            from drivecomm.cli.start_served import start_and_stay  # noqa: PLC0415

            return start_and_stay(
                cast("ServedDrive", one),
                partial(Watch, name, as_json=line.json),
                policy,
                watchdog or usual_s,
                percent=number(percent),
                hz=number(hz),
                reverse=reverse or None,
            )
        if policy != "hold":
            return _start_and_stay(one, name, run, policy, watchdog or usual_s, stops=line.stops, as_json=line.json)
        if watchdog is not None:
            raise UsageError("hold uses no watchdog; leave --watchdog out, or choose another policy")
        _start_and_leave(one, name, run, as_json=line.json)
    return 0


def _chosen_policy(drive: bus.Drive, text: str | None) -> LinkLoss:
    """Return the policy that was asked for. Raises UsageError with what to write where none was, or none that is."""
    if text is None:
        raise UsageError(
            f"no motor is started without saying what it does when this line falls silent; write {_choice(drive)}"
        )
    if text.lower() in get_args(LinkLoss):
        return cast("LinkLoss", text.lower())
    question = near(text, get_args(LinkLoss))
    known = f"{question} Write" if question else "write"
    raise UsageError(f"{text!r} is not a policy; {known} {_choice(drive)}")


def _start_and_leave(drive: bus.Drive, name: DriveConfig, start: Callable[[], None], *, as_json: bool) -> None:
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
        text = f"{name.name}  started, and goes on without this program"
        tell(text, as_json=as_json, **labels(name), done="started", link_loss="hold", watchdog_s=None)
        if not as_json and kept.watchdog is None:
            why = f"the model {drive.model.name} knows no watchdog; " if drive.model else ""
            say(f"  its own watchdog was not checked, because {why}{drive.capabilities.link_loss}")


def _stop_again(drive: bus.Drive, name: DriveConfig, *, as_json: bool) -> None:
    try:
        drive.stop()
    except DriveCommError as error:
        complain(f"{name.name} may be running, because its stop is not confirmed: {error}", as_json=as_json)
    else:
        complain(f"{name.name} was told to stop, because its start was interrupted", as_json=as_json)


def _start_and_stay(
    drive: bus.Drive,
    name: DriveConfig,
    start: Callable[[], None],
    policy: LinkLoss,
    watchdog_s: str,
    *,
    stops: StopsFromOthers,
    as_json: bool,
) -> int:
    """Start a motor and keep it in hand until Ctrl-C or a signal like it, or until it has a fault; return the code.

    A stop from another program ends it, too, and other drives of its line are stopped for it.
    """
    with until_stopped() as stop:
        watch = Watch(name, stop, as_json=as_json)
        kept = keep(drive, policy, watchdog_s=watchdog_s, on_failure=watch.failed, on_status=watch.answered)

        def end(how: Stop) -> None:
            kept.stop_by(how if how in drive.capabilities.stops else Stop.RAMP)
            stop.set()

        with stops.ended_by(drive.name, end) as asked, kept:
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


def _choice(drive: bus.Drive) -> str:
    """Return what can be written, in words."""
    known = policies(drive.model)
    watched = [f"--link-loss {policy}" for policy in known if policy != "hold"]
    if watched:
        return f"{' or '.join(watched)} (the drive's own watchdog, fed from here), or --link-loss hold (it goes on)"
    why = "with --model also what its own watchdog can" if drive.model is None else "its model knows no watchdog"
    return f"--link-loss hold (it goes on); {why}"
