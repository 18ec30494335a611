"""Commands `backup` and `compare`, and the drives whose parameters are saved, compared or restored."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.bus import carry_out
from drivecomm.cli import options
from drivecomm.cli.exploring import answer_logbook
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, labels, note, plain, progress_bar, say
from drivecomm.cli.values import FILE
from drivecomm.commissioning import addresses_in
from drivecomm.commissioning.parameter_sets import (
    WRITABLE,
    back_up,
    backup_plan,
    compare as compared,
    factory_set,
    must_be_free,
    percent,
    read_set,
    reading_everything,
    share_of,
    subject,
    write_set,
)
from drivecomm.errors import UsageError
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm import bus
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning.parameter_sets import (
        Comparison,
        Difference,
        ParameterEntry,
        ParameterSet,
        Part,
        SetSubject,
    )
    from drivecomm.protocol import DriveConfig, Model as KnownModel


set_model_option = click.option(
    "--model", "-m", metavar="MODEL", help="Model name, or a .toml file. Default: that of the set."
)
communication_option = click.option(
    "--communication", is_flag=True, help="Include communication settings: address, baud rate and the like."
)


@click.command(cls=LineCommand)
@options.drive
@click.argument("file", type=FILE, help="TOML file; an existing one is replaced.")
@options.model
@click.option("--all", "measured", is_flag=True, help="Also measured values, which are never restored.")
@click.option("--everything", is_flag=True, help="All that the drive holds: read every address; can be resumed.")
@click.option(
    "--within",
    metavar="PARAM or FIRST..LAST",
    multiple=True,
    help="With --everything: besides the model's parameters only these; repeatable.",
)
def backup(
    *,
    drive: str,
    file: Path,
    line: LineArguments,
    model: str | None,
    measured: bool,
    everything: bool,
    within: tuple[str, ...],
) -> int:
    """Save the parameters of a drive to a file. Parameters that cannot be read are listed in it.

    With --everything, every possible address is requested; values that the model does not know are kept as raw values,
    which are never restored. That takes minutes; after an interruption, run the same command to continue.
    """
    reached, name = line.reaching(drive)
    must_be_free(file, str(name))
    if everything and measured:
        raise UsageError("--everything includes measured values, so --all has no effect; leave it out")
    if within and not everything:
        raise UsageError("--within limits what --everything asks for; give --everything, too")
    with drive_of_set(reached, name, model) as one:
        of = subject(one)
        if everything:
            found = _save_everything(one, of, file, within, line)
        else:
            parts: tuple[Part, ...] = ("settings", "communication", "measured") if measured else WRITABLE
            with progress_bar("reading", shown=not line.json) as progress:
                found = back_up(one, parts, progress=progress)
            write_set(file, found)
    _show_saved(found, of.model, file, name, as_json=line.json)
    return 0


def _save_everything(
    drive: bus.Drive, of: SetSubject, file: Path, within: tuple[str, ...], line: LineArguments
) -> ParameterSet:
    way = backup_plan(of, addresses_in(within) if within else None)
    with answer_logbook(file, drive, way, "values", line) as (logbook, progress):
        found = carry_out(drive, reading_everything(of, way, logbook, progress))
        write_set(file, found)
        logbook.over()
    return found


def _show_saved(found: ParameterSet, model: KnownModel, file: Path, name: DriveConfig, *, as_json: bool) -> None:
    share, explored = share_of(found, model), found.explored
    if as_json:
        emit(**labels(name), model=found.model, file=str(file), parameters=len(found.entries),
             not_read=dict(found.not_read), share=plain(share), explored=plain(explored))  # fmt: skip
        return
    for address, reason in found.not_read.items():
        say(f"{name.name}  {address}  not read: {reason}")
    say(f"{name.name}  {len(found.entries)} parameters in {file}, {share}")
    if explored is None and installed[name.protocol].address_space is not None:
        note(
            "a drive has more parameters than its model knows; --everything saves them all as raw values, "
            "which a restore leaves alone"
        )
    if explored is not None:
        known = percent(explored.known, explored.answered)
        unknown = explored.answered - explored.known
        say(
            f"{name.name}  the drive answers {explored.answered} of {explored.asked} addresses; model {model.name} "
            f"knows {explored.known} of them ({known}), {unknown} are raw values that are never restored"
        )


@contextmanager
def drive_of_set(
    reached: LineArguments, name: DriveConfig, model: str | None, known: ParameterSet | None = None
) -> Iterator[bus.Drive]:
    """Open the line of a drive and yield the drive. known: a parameter set whose model is the default model."""
    of_set = {"model": known.model} if known and known.model and known.protocol == name.protocol else {}
    with reached.drive_at(replace(name, options={**of_set, **name.options}), model) as one:
        yield one


FACTORY = "factory"


@click.command(cls=LineCommand)
@click.argument("left", metavar="A", help="A drive, PROTOCOL:ADDRESS, or a file written by backup.")
@click.argument("right", metavar="B", help="As A, or factory: the drive's own default values.")
@set_model_option
@communication_option
@click.option("--all", "everything", is_flag=True, help="Everything, including measured values.")
def compare(
    *, left: str, right: str, line: LineArguments, model: str | None, communication: bool, everything: bool
) -> int:
    """List the parameters in which two drives or files differ. Exit code 1 when they do.

    Parameters that only one of them has are listed and counted separately, and are not a difference.
    """
    parts: list[Part] = ["settings"]
    if communication or everything:
        parts.append("communication")
    if everything:
        parts += ["measured", "unknown"]
    if FACTORY in (left, right) and (left == right or _file(left) or _file(right)):
        raise UsageError("factory means the default values that a drive reports; compare a drive with it")
    if _file(left) and _file(right):
        line.refuse("both are files and no drive is read")
        if model is not None:
            raise UsageError("both are files, which say their models, so --model has no effect; leave it out")
    files = {word: read_set(path) for word in (left, right) if (path := _file(word))}

    def operand(word: str, other: str) -> ParameterSet:
        """Return the parameters of a file or a drive, or the factory values of the other drive."""
        if word in files:
            return files[word]
        read, drive = (factory_set, other) if word == FACTORY else (back_up, word)
        with (
            drive_of_set(*line.reaching(drive), model, files.get(other)) as one,
            progress_bar("reading", shown=not line.json) as progress,
        ):
            return read(one, parts, progress=progress)

    ours, theirs = operand(left, right), operand(right, left)
    found = compared(ours, theirs, parts)
    _show_comparison(found, left, right, as_json=line.json)
    return 0 if found.same else 1


def _file(word: str) -> Path | None:
    """Return the file that a word names, None for a drive; a drive may be named with the file of its model."""
    path = Path(word)
    is_drive = word == FACTORY or ":" in word.partition(",")[0]
    return path if not is_drive and (path.suffix or path.exists()) else None


def _show_comparison(found: Comparison, left: str, right: str, *, as_json: bool) -> None:
    if as_json:
        for difference in (*found.differences, *found.missing):
            emit(kind=difference.kind, parameter=difference.address, name=difference.name,
                 left=entry_content(difference.left), right=entry_content(difference.right),
                  reason=difference.reason)  # fmt: skip
        emit(same=found.same, differences=len(found.differences), equal=found.equal, missing=len(found.missing),
             by=found.by, remarks=list(found.remarks), shares=plain(found.shares))  # fmt: skip
        return
    if found.differences:
        rows = [
            (parameter_label(each), entry_text(each.left), entry_text(each.right), each.reason)
            for each in found.differences
        ]
        for line in _in_columns([("", left, right, ""), *rows]):
            say(line)
    for side, absent in ((left, [each for each in found.missing if each.right is None]),
                         (right, [each for each in found.missing if each.left is None])):  # fmt: skip
        if absent:
            say(f"  only in {side}: {', '.join(map(parameter_label, absent))}")
    for remark in found.remarks:
        say(f"  {remark}")
    for side, share in zip((left, right), found.shares, strict=True):
        if share is not None and _file(side):
            say(f"  {side} holds {share}")
    count = len(found.differences)
    apart = f", {len(found.missing)} in one only" if found.missing else ""
    say(f"{count} difference{'' if count == 1 else 's'}, {found.equal} equal{apart}, by {found.by}")


def parameter_label(difference: Difference) -> str:
    """Return a parameter's address and name."""
    return f"{difference.address} {difference.name}".rstrip()


def _in_columns(rows: list[tuple[str, str, str, str]]) -> Iterator[str]:
    """Yield rows as lines: a name, two right-aligned values, and a remark."""
    name, left, right = (max(len(row[place]) for row in rows) for place in range(3))
    for row in rows:
        yield f"{row[0]:<{name}}  {row[1]:>{left}}  {row[2]:>{right}}  {row[3]}".rstrip()


def entry_text(entry: ParameterEntry | None) -> str:
    """Return a value as text."""
    return "-" if entry is None else str(entry) or '""'


def entry_content(entry: ParameterEntry | None) -> Any:
    """Return a value as JSON content."""
    return None if entry is None else {"value": entry.value, "unit": entry.unit, "raw": entry.raw}
