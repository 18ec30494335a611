"""Command `models import`: a model made from a register list, or from a file of another program."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, emit, print_columns, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE, WHOLE_NUMBER, OneOf
from drivecomm.commissioning.importing import drives_of, imported_model, read_foreign
from drivecomm.errors import UsageError, printable
from drivecomm.models import MONITORING_ONLY, model_text
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Literal

    from drivecomm.commissioning.importing import ForeignContents
    from drivecomm.protocol import Model, ParameterInfo

_PORT = "/dev/ttyUSB0"


@click.command("import", cls=CliCommand)
@click.argument("file", type=FILE, help="A register list, or a configuration that reads the registers of a drive.")
@click.option("--output", type=FILE, help="The model file to write. Default: FILE with the ending .toml, here.")
@click.option(
    "--register-base",
    type=OneOf(("0", "1", "modicon")),
    help="What a register list calls the first register: 0, 1, or 40001 and 30001. Default: by its addresses.",
)
@click.option("--address", type=WHOLE_NUMBER, help="Only the registers of this drive, if the file reads several.")
@click.option("--yes", is_flag=True, help="Write what is shown, without asking.")
@force_option
@options.json
def import_file(
    *,
    file: Path,
    output: Path | None,
    register_base: Literal["0", "1", "modicon"] | None,
    address: int | None,
    yes: bool,
    force: bool,
    json: bool,
) -> int:
    """Make a model from a register list, or from the configuration of another program.

    Its drives are monitoring only: they are read, and neither commanded nor written. Shows the registers found, the
    assumptions and the items left out, and asks before it writes. Exit code 1 if nothing is written.
    """
    path = output or Path(f"{file.stem}.toml")
    if path.suffix != ".toml":
        raise UsageError(f"a model file ends in .toml; write --output {path.with_suffix('.toml')}")
    must_be_free(path, "--output", force=force)
    found = read_foreign(file, register_base)
    name = re.sub(r"[^a-z0-9-]+", "-", path.stem.casefold()).strip("-") or "imported"
    model = imported_model(found, name=name, file=file.name, drive=address)
    if json:
        _emit(model, found)
    else:
        _show(model, found, file)
    if not (yes or _agreed(path, as_json=json)):
        tell(f"nothing is written; --yes writes {path}", as_json=json, file="")
        return 1
    write_atomically(path, f"{_head(found, file)}\n{model_text(model)}")
    if json:
        emit(file=str(path), next=_next(model, found, path, address))
    else:
        say(f"written to {path}, {MONITORING_ONLY}; next: {_next(model, found, path, address)}")
    return 0


def _agreed(path: Path, *, as_json: bool) -> bool:
    """Ask the user whether to write the file; False without a terminal."""
    if as_json or not sys.stdin.isatty():
        return False
    return click.confirm(f"Write {path}?", default=False, err=True)


def _show(model: Model, found: ForeignContents, file: Path) -> None:
    say(f"{file}: {found.form}, {counted(len(model.parameters), 'register')} understood")
    if found.columns:
        say(
            f"  columns: {', '.join(f'{column} = {printable(heading)!r}' for column, heading in found.columns.items())}"
        )
    if found.options:
        say(f"  line: {', '.join(f'{name}={value}' for name, value in found.options.items())}")
    for sentence in found.assumptions:
        say(f"  {sentence}")
    common = {address: name for name, address in model.quantities.items()}
    print_columns(_row(info, common.get(info.address, "")) for info in model.parameters.values())
    for each in found.left:
        say(f"not carried over: {printable(str(each))}")


def _row(info: ParameterInfo, common: str) -> tuple[str, ...]:
    does = "never written" if info.kind == "command" else "common name" if common else ""
    order = info.extra.get("word_order", "")
    part = "byte" if info.address.endswith((".low", ".high")) else "bit"
    held = f"{info.type or part}{f' {order} word first' if order else ''}"
    step = "" if info.factor == 1 else str(info.factor)
    return (f"  {info.address}", info.name, held, f"{step} {info.unit}".strip(), does, info.source.partition(", ")[2])


def _emit(model: Model, found: ForeignContents) -> None:
    emit(form=found.form, columns=found.columns, options=found.options, assumptions=found.assumptions)
    for info in model.parameters.values():
        emit(parameter=info)
    for each in found.left:
        emit(place=each.place, not_carried=each.what, reason=each.reason)


def _head(found: ForeignContents, file: Path) -> str:
    """Return the comment above the model: assumptions of the import, and items that are missing."""
    lines = [f"Imported from {file.name}, {found.form}. Monitoring only: nothing here commands a drive."]
    lines += [f"Assumed: {sentence}." for sentence in found.assumptions]
    lines += [f"Not carried over: {each}" for each in found.left]
    return "".join(f"# {printable(line)}\n" for line in lines)


def _next(model: Model, found: ForeignContents, path: Path, address: int | None) -> str:
    """Return a command that reads from such a drive, preferably a common name."""
    drive = address if address is not None else next(iter(drives_of(found)), 1)
    names = list(dict.fromkeys([*model.quantities, *_readable(model)]))
    return f"drivecomm read modbus:{drive or 1} {names[0]} --model {path} --port {found.port or _PORT}"


def _readable(model: Model) -> Iterator[str]:
    common = set(model.quantities.values())
    for info in model.parameters.values():
        if info.kind != "command" and info.address not in common:
            yield info.name
