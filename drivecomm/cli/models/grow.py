"""Command `models grow`: a model made from the answers of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli.exploring import answer_logbook
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, progress_bar, say
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.commissioning import grown_model, growth_plan, growth_request, parameters_of, unread_parameters
from drivecomm.commissioning.exploring import explore
from drivecomm.errors import DriveError, UsageError
from drivecomm.models import load_model, model_text
from drivecomm.protocol import installed, parse_options

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning.exploring import AddressAnswer, ExplorationPlan
    from drivecomm.protocol import Model as KnownModel, ParameterInfo, Protocol

# As many as fit on a screen; the rest is only counted.
_MOST_SHOWN = 10


@click.command(cls=LineCommand)
@click.argument("drive", help="PROTOCOL:ADDRESS, such as danfoss-fc:3.")
@click.option("--write", "-w", type=FILE, required=True, help="The model file to write.")
@click.argument(
    "parameters",
    metavar="[PARAM or FIRST..LAST...]",
    nargs=-1,
    help="Such as 3-41 or 16-10..16-18. Default: all of its model, or of the protocol's usual one.",
)
@click.option("--everything", is_flag=True, help="Every address that such a drive can have; can be resumed.")
@click.option("--model", "-m", metavar="MODEL", help="The model to start from; common names come from there.")
@click.option("--option", "-o", metavar="NAME=VALUE", multiple=True, help="Option of this protocol's describe.")
@force_option
def grow(
    *,
    drive: str,
    line: LineArguments,
    write: Path,
    parameters: tuple[str, ...],
    everything: bool,
    model: str | None,
    option: tuple[str, ...],
    force: bool,
) -> int:
    """Write a model file from the answers of a drive.

    Drives that can describe their parameters supply names, types, units, scales, limits, texts. Other drives only show
    which addresses they answer: a parameter that the base model does not have becomes read-only, without type and
    unconfirmed. Changes nothing in the drive. After an interruption, run the same command to continue. Exit code 5 if
    the drive answers nothing.
    """
    if write.suffix != ".toml":
        raise UsageError(f"a model file ends in .toml; write --write {write.with_suffix('.toml')}")
    must_be_free(write, "--write", force=force)
    if everything and parameters:
        raise UsageError("--everything asks for all parameters; name parameters or give --everything, not both")
    reached, name = line.reaching(drive)
    plugin = installed[name.protocol]
    options = parse_options(option)
    with reached.bus() as bus:
        one = name.with_options(**({"model": model} if model else {})).build(bus.drive)
        words = None if everything else parameters or list(_usual(one.model, plugin).parameters)
        way = growth_plan(plugin, one.model, words)
        asks = growth_request(plugin, one.model, options)
        if everything:
            asked = " ".join(["parameters", *(f"{key}={value}" for key, value in sorted(options.items()))])
            with answer_logbook(write, one, way, asked, line) as (logbook, progress):
                answers = explore(one, way, asks, logbook, progress=progress)
                told = [*parameters_of(answers, plugin, one.model, one.name), *unread_parameters(plugin, one.model)]
                made = _written(one, answers, told, write)
                logbook.over()
        else:
            with progress_bar("asking", shown=not line.json) as bar:
                answers = explore(one, way, asks, progress=lambda step: bar(step.answer.address, step.asked, step.of))
            made = _written(one, answers, parameters_of(answers, plugin, one.model, one.name), write)
    left_out = [answer for answer in answers if answer.told is None and _counts(answer, way)]
    if line.json:
        emit(
            drive=one.name,
            drive_name=name.name,
            file=str(write),
            parameters=len(made.parameters),
            left_out=[{"parameter": answer.address, "reason": answer.reason} for answer in left_out],
        )
        return 0
    say(f"{one.name}  {len(made.parameters)} parameters written to {write}")
    for answer in left_out[:_MOST_SHOWN]:
        say(f"  left out: {answer.reason}")
    if len(left_out) > _MOST_SHOWN:
        say(f"  left out: {len(left_out) - _MOST_SHOWN} more")
    return 0


def _written(drive: Drive, answers: list[AddressAnswer], told: list[ParameterInfo], file: Path) -> KnownModel:
    """Write the model made from a drive's answers, and return it. Raises DriveError without answers."""
    if not any(answer.told is not None for answer in answers):
        raise DriveError(f"{drive.name} answers none of {len(answers)} parameters, so there is no model to write")
    made = grown_model(
        told,
        protocol=drive.name.partition(":")[0],
        name=file.stem,
        title=f"{drive.model.title} as reported by {drive.name}"
        if drive.model
        else f"{drive.name} as reported by itself",
        source=f"description reported by {drive.name}",
        base=drive.model,
    )
    file.write_text(model_text(made), encoding="utf-8")
    return made


def _usual(model: KnownModel | None, plugin: Protocol) -> KnownModel:
    return model or load_model(plugin.package, plugin.name, plugin.default_model)


def _counts(answer: AddressAnswer, way: ExplorationPlan) -> bool:
    """Return whether a missing answer is worth reporting; most addresses that a drive may hold do not exist."""
    return answer.address in way.known or not answer.absent
