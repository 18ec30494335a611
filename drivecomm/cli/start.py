"""Command `start`: it starts a motor only with a stated policy for the loss of its master."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast, get_args

import click

from drivecomm.bus import USUAL_WATCHDOG_S, carry_out, keep, policies, reading_speed, starting, starting_by
from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.one_drive import number
from drivecomm.cli.output import complain, labels, say, tell
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.start_watch import news_shown
from drivecomm.errors import DriveCommError, DriveError, UsageError, did_you_mean
from drivecomm.protocol import LinkLoss, Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm import bus
    from drivecomm.bus import Procedure
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.stops_from_others import StopsFromOthers
    from drivecomm.client import ServedDrive
    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMethod:
    """Way to start a motor.

    procedure: returns the steps that start the motor from here. choices: options for a server that starts and keeps the
    motor. waits: whether a call or a write starts the motor, which may then run at a speed other than the reference,
    such as a jog speed.
    """

    procedure: Callable[[], Procedure[Any]]
    choices: Mapping[str, Any]
    waits: bool = False


@click.command(cls=LineCommand)
@options.drive
@options.link_loss
@options.watchdog
@click.option("--reverse", is_flag=True, help="Run in reverse.")
@click.option("--percent", metavar="NUMBER", help="Set the reference first, in percent.")
@click.option("--hz", metavar="NUMBER", help="Set the reference first, in hertz.")
@options.model
def start(
    *,
    drive: str,
    line: LineArguments,
    link_loss: str | None,
    watchdog: str | None,
    reverse: bool,
    percent: str | None,
    hz: str | None,
    model: str | None,
) -> int:
    """Start the motor; --link-loss says what it does when communication is lost.

    With hold it keeps running, and the command ends. Otherwise the command sets the drive's own watchdog first, then
    stays and feeds it until Ctrl-C, which stops the motor. Exit code 5 when the drive has a fault meanwhile.
    """
    with line.drive(drive, model) as (one, name):
        by = StartMethod(
            procedure=lambda: starting(reverse=reverse, percent=number(percent), hz=number(hz)),
            choices={"percent": number(percent), "hz": number(hz), "reverse": reverse or None},
        )
        return start_motor(one, name, line, drive, by, link_loss=link_loss, watchdog=watchdog)


def start_by(
    one: bus.Drive,
    name: DriveConfig,
    line: LineArguments,
    drive: str,
    *,
    verb: str,
    arguments: Mapping[str, Any],
    link_loss: str | None,
    watchdog: str | None,
) -> int:
    """Start a motor by another verb, such as call or write; see `start_motor`."""
    by = StartMethod(
        procedure=partial(starting_by, verb, arguments),
        choices={"by": {"verb": verb, "arguments": dict(arguments)}},
        waits=True,
    )
    return start_motor(one, name, line, drive, by, link_loss=link_loss, watchdog=watchdog)


def start_motor(
    one: bus.Drive,
    name: DriveConfig,
    line: LineArguments,
    drive: str,
    by: StartMethod,
    *,
    link_loss: str | None,
    watchdog: str | None,
) -> int:
    """Start a motor under a link loss policy, and keep it unless the policy is hold; return the exit code.

    drive: name of the drive on the command line. Raises UsageError if neither link_loss nor the plant names a policy.
    """
    if name.read_only_reason:
        # A read-only drive is refused before its watchdog is read.
        raise UsageError(name.read_only_reason)
    said = line.link_loss_of(drive)
    policy = _chosen_policy(one, link_loss or (said.policy if said else None), by)
    # The plant's watchdog time belongs to the plant's policy only.
    usual_s = f"{said.watchdog_s:g}" if said and policy == said.policy else str(USUAL_WATCHDOG_S)

    def run() -> str:
        carry_out(one, by.procedure())
        speed = carry_out(one, reading_speed(one.model, one.bus.now, waits=by.waits))
        what = "commanded" if by.waits else "started"
        return f"{what}, {speed}" if speed else what

    if policy != "hold" and line.reaching(drive)[0].server is not None:
        # Imported late, because only starts through a server need it.
        from drivecomm.cli.start_served import start_and_stay

        return start_and_stay(
            cast("ServedDrive", one),
            partial(news_shown, name, as_json=line.json),
            policy,
            watchdog or usual_s,
            **by.choices,
        )
    if policy != "hold":
        return _start_and_stay(one, name, run, policy, watchdog or usual_s, stops=line.stops, as_json=line.json)
    if watchdog is not None:
        raise UsageError("hold uses no watchdog; leave --watchdog out, or choose another policy")
    _start_and_leave(one, name, run, as_json=line.json)
    return 0


def _chosen_policy(drive: bus.Drive, text: str | None, by: StartMethod) -> LinkLoss:
    """Return the chosen policy. Raises UsageError with the possible options if the policy is missing or unknown."""
    if text is None:
        why = "this may start the motor; " if by.waits else ""
        raise UsageError(f"{why}choose what the motor does if this line goes dead: {_choice(drive)}")
    if text.lower() in get_args(LinkLoss):
        return cast("LinkLoss", text.lower())
    question = did_you_mean(text, get_args(LinkLoss))
    known = f"{question} Write" if question else "write"
    raise UsageError(f"{text!r} is not a policy; {known} {_choice(drive)}")


def _start_and_leave(drive: bus.Drive, name: DriveConfig, start: Callable[[], str], *, as_json: bool) -> None:
    """Start a motor without a watcher; its own watchdog, if its model has one, must be off.

    If the user interrupts before the success message, the motor is stopped again.
    """
    with until_stopped() as stop:
        with keep(drive, "hold") as kept:
            if stop.is_set():
                raise KeyboardInterrupt
            try:
                what = start()
            finally:
                if stop.is_set():
                    _stop_again(drive, name, as_json=as_json)
                    raise KeyboardInterrupt
        text = f"{name.name}  {what}; it keeps running without this program until drivecomm stop {name.name}"
        tell(text, as_json=as_json, **labels(name), done="started", link_loss="hold", watchdog_s=None)
        if not as_json and kept.watchdog is None:
            why = f"the {drive.model.name} model does not know its parameters; " if drive.model else ""
            say(f"  watchdog not checked: {why}{drive.capabilities.link_loss}")


def _stop_again(drive: bus.Drive, name: DriveConfig, *, as_json: bool) -> None:
    try:
        drive.stop()
    except DriveCommError as error:
        complain(f"{name.name} may be running, because its stop is not confirmed: {error}", as_json=as_json)
    else:
        complain(f"{name.name} received a stop, because its start was interrupted", as_json=as_json)


def _start_and_stay(
    drive: bus.Drive,
    name: DriveConfig,
    start: Callable[[], str],
    policy: LinkLoss,
    watchdog_s: str,
    *,
    stops: StopsFromOthers,
    as_json: bool,
) -> int:
    """Start a motor and keep it until Ctrl-C, a similar signal, or a fault; return the exit code.

    A stop from another program ends the keeping as well. Stops of other drives of the line are carried out meanwhile.
    """
    with until_stopped() as stop:
        news = news_shown(name, stop, as_json=as_json)
        kept = keep(drive, policy, watchdog_s=watchdog_s, on_failure=news.failed, on_status=news.answered)

        def end(how: Stop) -> None:
            kept.stop_by(how if how in drive.capabilities.stops else Stop.RAMP)
            stop.set()

        with stops.ended_by(drive.name, end) as asked, kept:
            news.watchdog_set(kept.watchdog)
            news.started("not started" if stop.is_set() or asked.is_set() else start(), policy, watchdog_s)
            kept.until(stop)
        news.stopped()
    return DriveError.exit_code if news.fault else 0


def _choice(drive: bus.Drive) -> str:
    """Return the possible link loss options of a drive, in words."""
    known = policies(drive.model)
    watched = [f"--link-loss {policy}" for policy in known if policy != "hold"]
    if watched:
        return f"{' or '.join(watched)} (the drive's own watchdog, fed from here), or --link-loss hold (keeps running)"
    if drive.model is None:
        return "--link-loss hold (keeps running); with --model, also trip, ramp or coast if its watchdog can"
    return "--link-loss hold (keeps running); its model has no watchdog for another policy"
