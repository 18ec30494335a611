"""Commands for one drive: read, write, start, stop, reset, reference, call."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.cli.drive_names import parse_settings, plant_file
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.opened_drive import drive_named, opened_drive
from drivecomm.cli.output import complain, emit, plain, say
from drivecomm.cli.stoppable import as_far_as_possible, stoppable_drive
from drivecomm.errors import DriveCommError, LinkError, UsageError, meant
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from drivecomm.cli.drive_names import DriveName
    from drivecomm.protocol import Reading

Name = Annotated[
    str,
    typer.Argument(
        metavar="DRIVE", help="PROTOCOL:ADDRESS or a name of the plant, with ,name=value options behind it."
    ),
]
Model = Annotated[str | None, typer.Option("--model", "-m", help="Model by name, or a .toml file.")]
Type = Annotated[str | None, typer.Option("--type", "-t", help="Type in the words of the protocol's manual.")]
Further = Annotated[
    list[str] | None,
    typer.Option("--option", "-o", metavar="NAME=VALUE", help="Option of this protocol's read or write."),
]


def read(
    drive: Name,
    parameters: Annotated[list[str], typer.Argument(metavar="PARAM...", help="Addresses or names of the model.")],
    line: LineOptions,
    model: Model = None,
    type: Type = None,
    option: Further = None,
) -> int:
    """Read parameters. A parameter that cannot be read does not keep the others from being read."""
    options = _verb_options(type, option)
    code = 0
    reached, name = line.reaching(drive)
    with opened_drive(reached, name, model) as one:
        for parameter in parameters:
            try:
                reading = one.read(parameter, **options)
            except LinkError:
                raise
            except DriveCommError as error:
                error.about = {**name.keys, "parameter": parameter}
                complain(error, as_json=line.json, where=f"{reached.named_port}, {name.name}, {parameter}")
                code = code or error.exit_code
            else:
                _show_reading(name, parameter, reading, as_json=line.json)
    return code


def write(
    drive: Name,
    parameter: Annotated[str, typer.Argument(metavar="PARAM", help="Address or name of the model.")],
    value: Annotated[str, typer.Argument(help="Physical where the model knows the scale.")],
    line: LineOptions,
    store: Annotated[bool, typer.Option("--store", help="Keep it over power-off (EEPROM).")] = False,
    read_back: Annotated[
        bool, typer.Option("--read-back", help="Read it afterwards; exit code 5 when the drive holds something else.")
    ] = False,
    model: Model = None,
    type: Type = None,
    option: Further = None,
) -> int:
    """Write a parameter; into RAM unless --store is given, where the protocol makes the difference."""
    with drive_named(line, drive, model) as (one, name):
        write = one.write_and_read if read_back else one.write
        reading = write(parameter, value, store=store, **_verb_options(type, option))
        if reading is not None:
            _show_reading(name, parameter, reading, as_json=line.json)
        elif line.json:
            emit(**name.keys, parameter=parameter, written=value, stored=store)
        else:
            say(f"{name.name}  {parameter} = {value}  written{' and stored' if store else ''}")
    return 0


def start(
    drive: Name,
    line: LineOptions,
    link_loss: Annotated[
        str | None,
        typer.Option(
            "--link-loss",
            metavar="POLICY",
            help="If this line falls silent: hold, ramp, coast or trip; the plant's if absent.",
        ),
    ] = None,
    watchdog: Annotated[
        str | None, typer.Option("--watchdog", metavar="SECONDS", help="How long the drive's own watchdog waits; 5.")
    ] = None,
    reverse: Annotated[bool, typer.Option("--reverse", help="Backwards.")] = False,
    percent: Annotated[str | None, typer.Option(help="Set the reference first, in percent.")] = None,
    hz: Annotated[str | None, typer.Option(help="Set the reference first, in hertz.")] = None,
    model: Model = None,
) -> int:
    """Start the motor; --link-loss says what it does when nobody speaks to it any more.

    With hold it goes on, and the command ends. Otherwise the drive's own watchdog is set first, and the command stays
    and feeds it until Ctrl-C, which stops the motor. Exit code 5 when the drive has a fault meanwhile.
    """
    # Threads and signals are for motors that turn.
    from drivecomm.cli import starting  # noqa: PLC0415

    said = line.link_loss_of(drive)
    with drive_named(line, drive, model) as (one, name):
        if reason := name.options.get("read_only"):
            # Said before its watchdog is looked at.
            raise UsageError(reason)
        policy = starting.chosen_policy(one, link_loss or (said.policy if said else None))
        # What the plant says of a watchdog belongs to the policy that it says.
        usual_s = f"{said.watchdog_s:g}" if said and policy == said.policy else "5"

        def run() -> None:
            given = percent is not None or hz is not None
            # Some drives take a reference only from whoever commands them, so a motor that runs is commanded first.
            runs = given and one.status().running
            if given and not runs:
                one.set_reference(percent=_number(percent), hz=_number(hz))
            one.start(reverse=reverse)
            if runs:
                one.set_reference(percent=_number(percent), hz=_number(hz))

        if policy != "hold":
            return starting.start_and_stay(
                one, name, run, policy, watchdog or usual_s, port=line.reaching(drive)[0].named_port, as_json=line.json
            )
        if watchdog is not None:
            raise UsageError("hold is without a watchdog; leave --watchdog out, or choose another policy")
        starting.start_and_leave(one, name, run, as_json=line.json)
    return 0


def stop(
    line: LineOptions,
    drive: Annotated[
        str | None, typer.Argument(metavar="DRIVE", help="PROTOCOL:ADDRESS, or PROTOCOL:* for all of them at once.")
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Stop everything that is on the line or in the plant.")
    ] = False,
    how: Annotated[str, typer.Option("--how", help="ramp, coast, quick or dc_brake.")] = "ramp",
    model: Model = None,
) -> int:
    """Stop the motor. The address `*` stops all drives of the protocol at once; nobody confirms that.

    --all sends every line a broadcast for each protocol, all lines at the same time, and then stops each drive of the
    plant by itself, so that it confirms. Exit code 5 unless every drive has confirmed; without a plant file none can.
    A drive that the plant does not arm is stopped, too.
    """
    chosen = _way_to_stop(how)
    if everything:
        # Kept apart, because nothing of it must be loaded to stop one drive, nor the other way round.
        from drivecomm.cli import stopping  # noqa: PLC0415

        if drive is not None:
            raise UsageError(f"--all stops everything; leave {drive} out, or leave --all out")
        file = plant_file(line.plant, port_given=line.port is not None)
        wanted = stopping.Everything(port=line.port, plant=file, how=chosen, opening=line.opening)
        return stopping.stop_all(wanted, as_json=line.json)
    if drive is None:
        raise UsageError("no drive named; write PROTOCOL:ADDRESS, or --all to stop everything")
    # Who holds the port for a drive that was started from here stops others on its line, too.
    from drivecomm.cli.stopped_elsewhere import stopped_elsewhere  # noqa: PLC0415 - with --all it goes another way

    if stopped_elsewhere(line, drive, model, chosen):
        return 0
    protocol, colon, address = drive.partition(":")
    if colon and address == "*":
        with line.bus() as bus:
            everybody, _ = as_far_as_possible(partial(bus.broadcast, protocol), {"model": model} if model else {})
            everybody.stop(chosen)
        told = f"stop ({chosen.value}) sent to all; nobody confirms a broadcast"
        if line.json:
            emit(drive=drive, done=told)
        else:
            say(f"{drive}  {told}")
        return 0
    with stoppable_drive(line, drive, model) as (one, name, without):
        one.stop(chosen)
        done(name, line, f"stop ({chosen.value}) commanded")
        if without:
            complain(without, as_json=line.json)
    return 0


def reset(drive: Name, line: LineOptions, model: Model = None) -> int:
    """Acknowledge a fault; the motor does not start by it."""
    with drive_named(line, drive, model) as (one, name):
        one.reset()
        done(name, line, "reset")
    return 0


def reference(
    drive: Name,
    line: LineOptions,
    value: Annotated[str | None, typer.Argument(metavar="[VALUE]", help="With its unit: 50%, 25Hz or 1450rpm.")] = None,
    percent: Annotated[str | None, typer.Option(help="Share of the reference range.")] = None,
    hz: Annotated[str | None, typer.Option(help="Output frequency.")] = None,
    rpm: Annotated[str | None, typer.Option(help="Speed, by the motor's name plate in the drive.")] = None,
    model: Model = None,
) -> int:
    """Set the reference; never stored."""
    if value is not None:
        for flag, said in (("percent", percent), ("hz", hz), ("rpm", rpm)):
            if said is not None:
                raise UsageError(f"{value} and --{flag} {said} exclude each other; leave one of them out")
        number, unit = _with_unit(value)
        percent, hz, rpm = (number if unit == each else said for each, said in _units(percent, hz, rpm))
    with drive_named(line, drive, model) as (one, name):
        one.set_reference(percent=_number(percent), hz=_number(hz), rpm=_number(rpm))
        done(name, line, *(f"reference {said} {unit}" for unit, said in _units(percent, hz, rpm) if said is not None))
    return 0


def call(
    drive: Name,
    verb: Annotated[str, typer.Argument(help="A verb that only this protocol has; a wrong one lists them.")],
    line: LineOptions,
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="NAME=VALUE...", help="Arguments of the verb, such as number=2.")
    ] = None,
    model: Model = None,
) -> int:
    """Carry out a verb that only this protocol has, such as jog or set_up."""
    with drive_named(line, drive, model) as (one, name):
        result = one.call(verb, **parse_settings(arguments or []))
        done(name, line, verb, result=result)
    return 0


def _way_to_stop(how: str) -> Stop:
    try:
        return Stop(how.lower().replace("-", "_"))
    except ValueError:
        known = meant(how, [stop.value for stop in Stop], "they are")
        raise UsageError(f"{how!r} is no way to stop; {known}") from None


def _units(percent: str | None, hz: str | None, rpm: str | None) -> tuple[tuple[str, str | None], ...]:
    return ("%", percent), ("Hz", hz), ("rpm", rpm)


def _with_unit(value: str) -> tuple[str, str]:
    """Return the number and the unit of a reference such as 50%."""
    text = value.strip()
    for unit in ("%", "Hz", "rpm"):
        if text.lower().endswith(unit.lower()):
            return text[: -len(unit)], unit
    raise UsageError(f"{value!r} has no unit; write {value}%, {value}Hz or {value}rpm")


def _verb_options(type: str | None, further: list[str] | None) -> dict[str, Any]:
    return {**parse_settings(further or []), **({"type": type} if type else {})}


def _number(text: str | None) -> Decimal | None:
    if text is None:
        return None
    try:
        return Decimal(text.strip().removesuffix("%").strip())
    except InvalidOperation:
        raise UsageError(f"{text!r} is no number") from None


def _show_reading(drive: DriveName, parameter: str, reading: Reading, *, as_json: bool) -> None:
    if as_json:
        told = {**plain(reading), "parameter": parameter, "address": reading.parameter, "quantity": reading.name}
        emit(**{**drive.keys, **told, "name": drive.name})
        return
    name = f"{reading.parameter} {reading.name}".rstrip()
    note = f"  [{reading.note}]" if reading.note else ""
    say(f"{drive.name}  {name:<34} {reading!s:>14}{note}".rstrip())


def done(drive: DriveName, line: LineOptions, what: str, *, result: object = None) -> None:
    """Say what was done with a drive."""
    if line.json:
        emit(**drive.keys, done=what, result=result)
        return
    say(f"{drive.name}  {what}" + (f": {result}" if result is not None else ""))
