"""Commands for one drive, and their common functions."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.commands import NEGATIVE_NUMBERS
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import complain, emit, labels, machine_content, plain, say, tell
from drivecomm.cli.values import NUMBER
from drivecomm.errors import DriveCommError, LinkError, NotSupported, UsageError, suggestion
from drivecomm.protocol import DriveState, exact, parse_options

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm import bus
    from drivecomm.bus import Goal
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import DriveConfig, DriveStatus, MachineUnit, Reading


_UNITS = {"percent": "%", "hz": "Hz", "rpm": "rpm"}
"""Units of references that every drive may accept, by their flags."""
_FIGURE = re.compile(r"[+-]?[0-9]+(\.[0-9]+)?")


def verb_options(type: str | None, further: tuple[str, ...]) -> dict[str, Any]:
    """Return the options of a read or write. Raises UsageError."""
    return {**parse_options(further), **({"type": type} if type else {})}


def number(text: str | None) -> Decimal | None:
    """Return a number with the digits as written; None for None. Raises UsageError."""
    return None if text is None else exact(text.strip().removesuffix("%").strip(), "reference")


def show_reading(drive: DriveConfig, parameter: str, reading: Reading, *, as_json: bool) -> None:
    """Print a reading. parameter: the parameter as written by the user."""
    told = {**plain(reading), "parameter": parameter, "address": reading.parameter, "quantity": reading.name}
    name = f"{reading.parameter} {reading.name}".rstrip()
    note = f"  [{reading.remark}]" if reading.remark else ""
    machine = drive.machine.beside(reading) if drive.machine is not None else None
    beside = f" = {machine}" if machine is not None else ""
    text = f"{drive.name}  {name:<34} {reading!s:>14}{beside}{note}".rstrip()
    further = machine_content(machine) if machine is not None else {}
    tell(text, as_json=as_json, **{**labels(drive), **told, **further, "name": drive.name})


def show_status(drive: DriveConfig, found: DriveStatus, *, as_json: bool, standing_stop: str = "") -> None:
    """Print the status of one drive on a line. standing_stop: its standing stop at the server, for JSON output."""
    machine = None if drive.machine is None or found.actual_hz is None else drive.machine.shown(found.actual_hz)
    if as_json:
        further = {"standing_stop": standing_stop} if standing_stop else {}
        if machine is not None:
            further |= {"actual_machine": str(machine.value), "machine_unit": machine.unit}
        emit(**labels(drive), **plain(found), **further)
        return
    words = [f"{drive.name}  {found.state.value}  word 0x{found.word:04X}"]
    if found.fault_code:
        words.append(f"fault {found.fault_code}" + (f" {found.fault_text}" if found.fault_text else ""))
    if found.actual_percent is not None:
        words.append(f"actual {found.actual_percent:.2f} %")
    if found.actual_hz is not None:
        words.append(f"actual {found.actual_hz} Hz" + (f" = {machine}" if machine is not None else ""))
    if found.flags:
        words.append(f"({', '.join(found.flags)})")
    say("  ".join(words))


def done(drive: DriveConfig, line: LineArguments, what: str, *, result: object = None) -> None:
    """Print the completed action on a drive."""
    text = f"{drive.name}  {what}" + (f": {result}" if result is not None else "")
    tell(text, as_json=line.json, **labels(drive), done=what, result=result)


@click.command(cls=LineCommand)
@options.drive
@click.argument("parameters", metavar="PARAM...", nargs=-1, required=True, help="Addresses, or names from the model.")
@options.model
@options.data_type
@options.verb_option
def read(
    *,
    drive: str,
    parameters: tuple[str, ...],
    line: LineArguments,
    model: str | None,
    type: str | None,
    option: tuple[str, ...],
) -> int:
    """Read parameters. If one cannot be read, the others still are."""
    options = verb_options(type, option)
    code = 0
    reached, name = line.reaching(drive)
    with reached.drive_at(name, model) as one:
        for parameter in parameters:
            try:
                reading = one.read(parameter, **options)
            except LinkError:
                raise
            except DriveCommError as error:
                error.about = {**labels(name), "parameter": parameter}
                complain(error, as_json=line.json, where=f"{reached.named_port}, {name.name}, {parameter}")
                code = code or error.exit_code
            else:
                show_reading(name, parameter, reading, as_json=line.json)
    return code


@click.command(cls=LineCommand, context_settings=NEGATIVE_NUMBERS)
@options.drive
@click.argument("parameter", metavar="PARAM", help="Address, or name from the model.")
@click.argument("value", help="In physical units where the model has the scale.")
@click.option("--store", is_flag=True, help="Store it in EEPROM, so that it survives power-off.")
@click.option("--read-back", is_flag=True, help="Read it back; exit code 5 when the drive holds another value.")
@options.link_loss
@options.watchdog
@options.model
@options.data_type
@options.verb_option
def write(
    *,
    drive: str,
    parameter: str,
    value: str,
    line: LineArguments,
    store: bool,
    read_back: bool,
    link_loss: str | None,
    watchdog: str | None,
    model: str | None,
    type: str | None,
    option: tuple[str, ...],
) -> int:
    """Write a parameter: to RAM, or with --store to EEPROM, where the protocol distinguishes them.

    A write that may start the motor, such as to a control word, needs --link-loss and keeps the motor like start.
    """
    options = {"store": store, **verb_options(type, option)}
    with line.drive(drive, model) as (one, name):
        verb = "write_and_read" if read_back else "write"
        arguments = {**options, "parameter": parameter, "value": value}
        if not name.read_only_reason and one.may_start(verb, **arguments):
            return _start_by(
                one, name, line, drive, verb=verb, arguments=arguments,
                link_loss=link_loss, watchdog=watchdog,
            )  # fmt: skip
        _starts_nothing(link_loss, watchdog)
        write = one.write_and_read if read_back else one.write
        reading = write(parameter, value, **options)
        if reading is not None:
            show_reading(name, parameter, reading, as_json=line.json)
        else:
            text = f"{name.name}  {parameter} = {value}  written{' and stored' if store else ''}"
            tell(text, as_json=line.json, **labels(name), parameter=parameter, written=value, stored=store)
    return 0


@click.command(cls=LineCommand)
@options.drive
@click.argument("verb", help="A function of this protocol; an unknown name lists them all.")
@click.argument("arguments", metavar="[NAME=VALUE...]", nargs=-1, help="Its arguments, such as number=2.")
@options.link_loss
@options.watchdog
@options.model
def call(
    *,
    drive: str,
    verb: str,
    line: LineArguments,
    arguments: tuple[str, ...],
    link_loss: str | None,
    watchdog: str | None,
    model: str | None,
) -> int:
    """Call a function that only this protocol has, such as jog.

    A function that may start the motor needs --link-loss, and keeps the motor like start: with hold it keeps running
    and the command ends, otherwise Ctrl-C stops it.
    """
    given = parse_options(arguments)
    with line.drive(drive, model) as (one, name):
        if not name.read_only_reason and one.may_start("call", **{**given, "verb": verb}):
            return _start_by(
                one, name, line, drive, verb="call", arguments={**given, "verb": verb},
                link_loss=link_loss, watchdog=watchdog,
            )  # fmt: skip
        _starts_nothing(link_loss, watchdog)
        result = one.call(verb, **given)
        done(name, line, verb, result=result)
    return 0


def _start_by(*values: Any, **options: Any) -> int:
    """Start the motor by a call or a write; imported late, because few calls start a motor."""
    from drivecomm.cli.start import start_by

    return start_by(*values, **options)


def _starts_nothing(link_loss: str | None, watchdog: str | None) -> None:
    """Raise UsageError if a link loss option is given for a command that does not start the motor."""
    for flag, given in (("--link-loss", link_loss), ("--watchdog", watchdog)):
        if given is not None:
            raise UsageError(f"{flag} only applies to a start of the motor, which this is not; leave it out")


@click.command(cls=LineCommand)
@options.drive
@options.model
def reset(*, drive: str, line: LineArguments, model: str | None) -> int:
    """Acknowledge a fault; this does not start the motor."""
    with line.drive(drive, model) as (one, name):
        one.reset()
        done(name, line, "reset")
    return 0


@click.command(cls=LineCommand, context_settings=NEGATIVE_NUMBERS)
@options.drive
@click.argument("value", required=False, help="With its unit: 50%, 25Hz, 1450rpm, or that of its machine.")
@click.option("--percent", metavar="NUMBER", help="Percent of the reference range.")
@click.option("--hz", metavar="NUMBER", help="Output frequency in hertz.")
@click.option("--rpm", metavar="NUMBER", help="Speed, from the motor data in the drive.")
@click.option("--machine", metavar="NUMBER", help="Speed of the machine, in its unit from the plant file.")
@options.model
def reference(
    *,
    drive: str,
    line: LineArguments,
    value: str | None,
    model: str | None,
    **given: str | None,
) -> int:
    """Set the reference; it is never stored."""
    reached, name = line.reaching(drive)
    if value is not None:
        for flag, said in given.items():
            if said is not None:
                raise UsageError(f"{value} and --{flag} {said} exclude each other; leave one of them out")
        flag, figure = _with_unit(value, name.machine)
        given[flag] = figure
    with reached.drive_at(name, model) as one:
        machine = given.pop("machine")
        try:
            one.set_reference(**{flag: number(said) for flag, said in given.items()}, machine=machine)
        except NotSupported as error:
            raise _with_range(one, error) from None
        words = [f"{said} {_UNITS[flag]}" for flag, said in given.items() if said is not None]
        if machine is not None and name.machine is not None:
            figure = machine.strip().removesuffix(name.machine.unit).strip()
            words.append(f"{figure} {name.machine.unit} ({name.machine.reference_hz(machine)} Hz)")
        done(name, line, f"reference {words[0]}")
    return 0


def _with_range(drive: bus.Drive, error: NotSupported) -> NotSupported:
    """Return an error about a missing reference range, with the maximum reference that the drive reports, if any."""
    if not any("reference_maximum_hz" in each for each in error.says):
        return error
    with suppress(DriveCommError):
        found = drive.read("maximum_reference")
        value = f"{float(found.value):g}"
        option = f"reference_maximum_hz={value}"
        return NotSupported(
            f"the drive takes a percentage of its maximum reference, which is {value} (parameter "
            f"{found.parameter}); if its unit is Hz, give {option}",
            says=option,
        )
    return error


def _with_unit(value: str, machine: MachineUnit | None) -> tuple[str, str]:
    """Return the flag for a reference such as 50%, and its value; the value of a machine speed keeps its unit."""
    text = value.strip()
    own = machine.unit if machine is not None and text.endswith(machine.unit) else ""
    for flag, unit in _UNITS.items():
        if not text.lower().endswith(unit.lower()) or len(own) > len(unit):
            continue
        figure = text[: -len(unit)].strip()
        if machine is not None and machine.unit.casefold() == unit.casefold():
            raise UsageError(
                f"{value!r} may be a speed of the motor or of its machine, which also uses {machine.unit}; write "
                f"--{flag} {figure} or --machine {figure}"
            )
        return flag, figure
    if own:
        return "machine", text
    if begin := _FIGURE.match(text):
        units = [*_UNITS.values(), *([machine.unit] if machine is not None else [])]
        raise UsageError(
            f"{value!r} is not a reference in {_either(units)}; write {_either([begin[0] + unit for unit in units])}"
            + ("" if machine is not None else ', or machine = { unit = "m/min", per_hz = "1.25" } in the plant file')
        )
    raise UsageError(f"{value!r} is not a reference; write a number and its unit, such as 50%, 25Hz or 1450rpm")


def _either(words: list[str]) -> str:
    *others, last = words
    return f"{', '.join(others)} or {last}"


@click.command(cls=LineCommand)
@options.drive
@click.argument("state", help="ready, running, stopping, fault, not_ready or at_reference.")
@click.option("--seconds", type=NUMBER, default=10.0, help="Maximum waiting time.")
@options.model
def wait(*, drive: str, state: str, line: LineArguments, seconds: float, model: str | None) -> int:
    """Wait until a drive reaches a state. Exit code 5 when it does not reach it in time, or has a fault."""
    goals: dict[str, Goal] = {"at_reference": "at_reference", **{each.value: each for each in DriveState}}
    goal = goals.get(state.lower().replace("-", "_"))
    if goal is None:
        raise UsageError(f"unknown state {state!r}; {suggestion(state, goals, 'write one of')}")
    with line.drive(drive, model) as (one, name):
        show_status(name, one.wait_for(goal, seconds), as_json=line.json)
    return 0
