"""Commands for parameter sets: backup, compare, restore."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.opened_drive import opened_drive
from drivecomm.cli.output import complain, emit, plain, say
from drivecomm.commissioning.parameter_sets import (
    RestoreOptions,
    back_up,
    carry_out_plan,
    compare as compared,
    factory_set,
    found_journal,
    journal_path,
    must_be_free,
    new_journal,
    plan_restore,
    read_set,
    write_set,
)
from drivecomm.errors import DriveError, LinkError, ReplyError, UsageError

if TYPE_CHECKING:
    from drivecomm.bus import Drive
    from drivecomm.cli.drive_names import DriveName
    from drivecomm.commissioning.parameter_sets import (
        Comparison,
        Difference,
        Entry,
        Journal,
        ParameterSet,
        Part,
        Plan,
        Planned,
        Restored,
    )

    Progress = Callable[[str, int, int], None]

FACTORY = "factory"
INCOMPLETE = 1
"""Exit code of a restore that did all it could, and left alone what it should have restored."""

Model = Annotated[
    str | None, typer.Option("--model", "-m", help="Model by name, or a .toml file; that of the set if absent.")
]
Communication = Annotated[bool, typer.Option("--communication", help="Addresses, baud rates and the like, too.")]


def backup(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help="PROTOCOL:ADDRESS, with ,name=value options.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="TOML, such as pump.toml; an older one is replaced.")],
    line: LineOptions,
    model: Annotated[str | None, typer.Option("--model", "-m", help="Model by name, or a .toml file.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Measured values, too; they are never restored.")] = False,
) -> int:
    """Write the parameters of a drive into a file. What the drive does not tell is listed in it."""
    _, name = line.reaching(drive)
    must_be_free(file, str(name))
    parts: list[Part] = ["settings", "communication", *(["measured"] if everything else [])]  # type: ignore[list-item]
    with _drive(line, drive, model) as one, _progress("reading", line) as progress:
        found = back_up(one, parts, progress=progress)
    write_set(file, found)
    if line.json:
        emit(**name.keys, model=found.model, file=str(file), parameters=len(found.entries),
             not_read=dict(found.not_read))  # fmt: skip
        return 0
    for address, reason in found.not_read.items():
        say(f"{name.name}  {address}  not read: {reason}")
    say(f"{name.name}  {len(found.entries)} parameters in {file}")
    return 0


def compare(
    left: Annotated[str, typer.Argument(metavar="A", help="A drive, PROTOCOL:ADDRESS, or a parameter set's file.")],
    right: Annotated[str, typer.Argument(metavar="B", help="As A, or factory: what the drive says of itself.")],
    line: LineOptions,
    model: Model = None,
    communication: Communication = False,
    everything: Annotated[bool, typer.Option("--all", help="Everything, measured values too.")] = False,
) -> int:
    """Tell in which parameters two drives or files differ. Exit code 1 when they do.

    What one of them merely lacks is listed and counted apart, and is no difference.
    """
    parts: list[Part] = ["settings"]
    if communication or everything:
        parts.append("communication")
    if everything:
        parts.append("measured")
    if FACTORY in (left, right) and (left == right or _file(left) or _file(right)):
        raise UsageError("factory stands for what a drive says of itself; compare a drive with it")
    if _file(left) and _file(right):
        line.refuse("both are files, so no drive is asked")
        if model is not None:
            raise UsageError("both are files, which say their models, so that --model has no effect; leave it out")
    files = {word: read_set(path) for word in (left, right) if (path := _file(word))}
    read = _Operands(files, model, parts, line)
    ours, theirs = read(left, right), read(right, left)
    found = compared(ours, theirs, parts)
    _show_comparison(found, left, right, as_json=line.json)
    return 0 if found.same else 1


def restore(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help="PROTOCOL:ADDRESS, with ,name=value options.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What backup wrote.")],
    line: LineOptions,
    model: Model = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only tell what would be written.")] = False,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PARAM", help="Only this parameter; repeat it for more.")
    ] = None,
    communication: Communication = False,
    another_drive: Annotated[
        bool, typer.Option("--another-drive", help="The set is of another drive, model or maker, and that is meant.")
    ] = False,
    volatile: Annotated[bool, typer.Option("--volatile", help="Into RAM; without, it is kept over power-off.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a restore that was cut off.")] = False,
) -> int:
    """Give a drive the parameters of a file, each read back; whatever is equal already is not written.

    Exit code 5 when the drive refuses some, 1 when some of its own settings cannot be restored; 2 when nothing can be
    written, to a read-only drive for example.
    """
    if resume and dry_run:
        raise UsageError("--dry-run writes nothing, so that --resume has no effect; leave one of them out")
    known = read_set(file)
    _, name = line.reaching(drive)
    at = journal_path(file, str(name))
    journal = None
    if not dry_run:
        journal = (found_journal if resume else new_journal)(at, known, str(name))
    options = RestoreOptions(
        only=frozenset(only or []), communication=communication, another_drive=another_drive, volatile=volatile
    )
    with _drive(line, drive, model, known) as one:
        with _progress("reading", line) as progress:
            plan = plan_restore(one, known, options, progress=progress)
        if journal is None:
            _show_plan(plan, name, as_json=line.json)
            return INCOMPLETE if plan.missed else 0
        with _said_how_to_go_on(journal, line), _progress("writing", line) as progress:
            done = carry_out_plan(one, plan, journal, progress=progress)
    _show_restored(done, name, as_json=line.json)
    if done.refused:
        return DriveError.exit_code
    if done.unconfirmed or done.left:
        return ReplyError.exit_code
    return 0 if done.complete else INCOMPLETE


@contextmanager
def _drive(line: LineOptions, text: str, model: str | None, beside: ParameterSet | None = None) -> Iterator[Drive]:
    """Open the line of a drive and yield it. beside: the set whose model it has where nobody has named one."""
    reached, name = line.reaching(text)
    of_set = {"model": beside.model} if beside and beside.model and beside.protocol == name.protocol else {}
    with opened_drive(reached, replace(name, options={**of_set, **name.options}), model) as one:
        yield one


@contextmanager
def _progress(what: str, line: LineOptions) -> Iterator[Progress]:
    """Show on a terminal how far it is; a script sees nothing of it."""
    from rich.console import Console  # noqa: PLC0415 - rich is loaded only where something is drawn
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    silent = line.json or not sys.stderr.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=silent) as drawing:
        task = drawing.add_task(what, total=None)

        def show(address: str, done: int, total: int) -> None:
            drawing.update(task, description=f"{what} {address}".rstrip(), completed=done, total=total)

        yield show


@contextmanager
def _said_how_to_go_on(journal: Journal, line: LineOptions) -> Iterator[None]:
    """Say of a restore that is cut off that it can go on."""
    try:
        yield
    except (LinkError, ReplyError) as error:
        error.args = (f"{error}; {_how_to_go_on(journal)}", *error.args[1:])
        raise
    except KeyboardInterrupt:
        complain(_how_to_go_on(journal), as_json=line.json)
        raise


def _how_to_go_on(journal: Journal) -> str:
    if not journal.written:
        return "nothing was written"
    count = len(journal.written)
    return f"{count} parameter{'s were' if count > 1 else ' was'} written, the same command with --resume goes on"


# Comparing


def _file(word: str) -> Path | None:
    """Return the file that a word names, None for a drive; a drive may be named with the file of its model."""
    path = Path(word)
    is_drive = word == FACTORY or ":" in word.partition(",")[0]
    return path if not is_drive and (path.suffix or path.exists()) else None


class _Operands:
    """What is compared, read from drives where it is in no file."""

    def __init__(self, files: dict[str, ParameterSet], model: str | None, parts: list[Part], line: LineOptions) -> None:
        self._files, self._model, self._parts, self._line = files, model, parts, line

    def __call__(self, word: str, other: str) -> ParameterSet:
        """Return the parameters of a file or a drive, or the factory values of the other drive."""
        if word in self._files:
            return self._files[word]
        read, drive = (factory_set, other) if word == FACTORY else (back_up, word)
        with (
            _drive(self._line, drive, self._model, self._files.get(other)) as one,
            _progress("reading", self._line) as progress,
        ):
            return read(one, self._parts, progress=progress)


def _show_comparison(found: Comparison, left: str, right: str, *, as_json: bool) -> None:
    if as_json:
        for difference in (*found.differences, *found.missing):
            emit(kind=difference.kind, parameter=difference.address, name=difference.name,
                 left=_told(difference.left), right=_told(difference.right), reason=difference.reason)  # fmt: skip
        emit(same=found.same, differences=len(found.differences), equal=found.equal, missing=len(found.missing),
             by=found.by, remarks=list(found.remarks))  # fmt: skip
        return
    if found.differences:
        rows = [(_called(each), _shown(each.left), _shown(each.right), each.reason) for each in found.differences]
        for line in _in_columns([("", left, right, ""), *rows]):
            say(line)
    for side, absent in ((left, [each for each in found.missing if each.right is None]),
                         (right, [each for each in found.missing if each.left is None])):  # fmt: skip
        if absent:
            say(f"  only in {side}: {', '.join(map(_called, absent))}")
    for remark in found.remarks:
        say(f"  {remark}")
    count = len(found.differences)
    apart = f", {len(found.missing)} in one only" if found.missing else ""
    say(f"{count} difference{'' if count == 1 else 's'}, {found.equal} equal{apart}, by {found.by}")


def _called(difference: Difference) -> str:
    return f"{difference.address} {difference.name}".rstrip()


def _in_columns(rows: list[tuple[str, str, str, str]]) -> Iterator[str]:
    """Yield rows as lines: a name, two values that end under each other, and a remark."""
    name, left, right = (max(len(row[place]) for row in rows) for place in range(3))
    for row in rows:
        yield f"{row[0]:<{name}}  {row[1]:>{left}}  {row[2]:>{right}}  {row[3]}".rstrip()


def _shown(entry: Entry | None) -> str:
    return "-" if entry is None else str(entry) or '""'


def _told(entry: Entry | None) -> Any:
    return None if entry is None else {"value": entry.value, "unit": entry.unit, "raw": entry.raw}


# Restoring


def _show_plan(plan: Plan, drive: DriveName, *, as_json: bool) -> None:
    if as_json:
        for item in plan.items:
            told = {**plain(item), "stage": item.stage.name.lower(), "quantity": item.name}
            emit(**{**drive.keys, **told, "name": drive.name})
        emit(**drive.keys, write=len(plan.to("write")), equal=len(plan.to("equal")), skip=len(plan.to("skip")),
             missed=len(plan.missed), stored=plan.store, remarks=list(plan.remarks))  # fmt: skip
        return
    _show_changes(plan.to("write"), drive)
    _show_skipped(plan, drive)
    counts = f"{len(plan.to('write'))} to write, {len(plan.to('equal'))} equal{_left_alone(plan)}"
    say(f"{drive.name}  {counts}; nothing was written")


def _show_changes(items: list[Planned], drive: DriveName) -> None:
    """Say what each of these was before and what it is to be."""
    names = [f"{item.address} {item.name}" for item in items]
    width = max(map(len, names), default=0)
    for name, item in zip(names, items, strict=True):
        before = "?" if item.current is None else item.current
        say(f"{drive.name}  {name:<{width}}  {before} -> {item.value} {item.unit}".rstrip())


def _left_alone(plan: Plan) -> str:
    """Return how much of a set is not restored, of that first what should have been."""
    missed, as_meant = len(plan.missed), len(plan.to("skip")) - len(plan.missed)
    told = f", {missed} not restored" if missed else ""
    return told + (f", {as_meant} left alone" if as_meant else "")


def _show_skipped(plan: Plan, drive: DriveName) -> None:
    for remark in plan.remarks:
        say(f"{drive.name}  {remark}")
    by_reason: dict[tuple[bool, str], list[Planned]] = {}
    for item in plan.to("skip"):
        by_reason.setdefault((item.missed, item.reason), []).append(item)
    for (missed, reason), items in by_reason.items():
        names = ", ".join(f"{item.address} {item.name}".rstrip() for item in items)
        say(f"{drive.name}  {'not restored' if missed else 'left alone'}, {reason}: {names}")


def _show_restored(done: Restored, drive: DriveName, *, as_json: bool) -> None:
    plan = done.plan
    if as_json:
        emit(**drive.keys, written=list(done.written), equal=len(plan.to("equal")), stored=plan.store,
             skipped={item.address: item.reason for item in plan.to("skip")}, refused=dict(done.refused),
             missed=[item.address for item in plan.missed], unconfirmed=list(done.unconfirmed), left=list(done.left),
             complete=done.complete)  # fmt: skip
        return
    planned = {item.address: item for item in plan.items}
    _show_changes([planned[address] for address in done.written], drive)
    _show_skipped(plan, drive)
    for address, reason in done.refused.items():
        say(f"{drive.name}  {address} does not hold what it should: {reason}")
    if done.unconfirmed:
        names = ", ".join(done.unconfirmed)
        left = f", and {', '.join(done.left)} not written" if done.left else ""
        say(f"{drive.name}  {names} written{left}: it does not answer as before; use its new settings and --resume")
    kept = "and stored" if plan.store else "without asking for storage"
    refused = f", {len(done.refused)} refused by the drive" if done.refused else ""
    equal = f"{len(plan.to('equal'))} equal before"
    say(f"{drive.name}  {len(done.written)} written {kept}, {equal}{refused}{_left_alone(plan)}")
