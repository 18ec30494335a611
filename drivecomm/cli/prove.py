"""Command `prove`: a real drive compared with its model, as a report that others can check."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import complain, counted, emit, labels, note, progress_bar, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.values import FILE
from drivecomm.errors import LinkError, ReplyError, UsageError, in_one_line
from drivecomm.proving import Moving, ProofRecord, ProofSubject, Proving, questions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import DriveConfig
    from drivecomm.proving import Proof

_CONTRADICTED = 1
_MOST_SHOWN = 20
_ONLY_ASKS = "a proof without --move only reads"


@click.command(cls=LineCommand)
@options.drive
@options.model
@click.option("--write", "-w", type=FILE, help="The report. Default: proof-PROTOCOL-MODEL.toml here.")
@click.option(
    "--name-plate", metavar="TEXT", default="", help="Maker, type and rating as its name plate says; no serial number."
)
@click.option("--with-names", is_flag=True, help="Leave serial numbers, names and addresses in the report.")
@click.option("--move", is_flag=True, help="Also start the motor slowly, stop it, and let the link fail; asks first.")
@click.option("--dry-run", is_flag=True, help="Only print the planned requests.")
@force_option
def prove(
    *,
    drive: str,
    line: LineArguments,
    model: str | None,
    write: Path | None,
    name_plate: str,
    with_names: bool,
    move: bool,
    dry_run: bool,
    force: bool,
) -> int:
    """Compare a drive with its model, and report the facts that agree, those that contradict, and new ones.

    Takes one to three minutes. Nothing is written to the drive and no motor moves, unless --move is given and confirmed
    by the drive's name. Ctrl-C leaves a complete report that states where it was interrupted. Exit code 1 if the drive
    contradicts its model.
    """
    reached, name = line.reaching(drive)
    given = name.with_options(**({"model": model} if model else {}))
    reason = name.read_only_reason
    if move and reason:
        raise UsageError(reason)
    asking = replace(given, read_only_reason=reason or _ONLY_ASKS)
    if dry_run:
        return _show_questions(asking, move=move, as_json=line.json)
    reached.must_be_free("prove")
    with reached.drive_at(asking) as one, progress_bar("asking for", shown=not line.json) as progress:
        subject = _subject(asking, one)
        path = write or Path(f"proof-{subject.plugin.name}-{subject.model.name}.toml")
        must_be_free(path, "--write", force=force and path.is_file())
        if move:
            _must_agree(name, subject.model.title)
        proving = Proving(one, subject, with_names=with_names, progress=progress)
        private = {} if with_names else {reached.named_port: "its port", name.name: "the drive", one.name: "the drive"}
        record = ProofRecord(
            path,
            proving,
            port=reached.named_port,
            options={key: value for key, value in asking.options.items() if key != "model"},
            name_plate=name_plate,
            moved=move,
            private=private,
        )
        record.write()
        proving.on_section = record.write
        with _always_whole(record, path, as_json=line.json):
            proving.run()
            if move:
                _move(proving, given.build(one.bus.drive), as_json=line.json)
        proof = record.write()
    _show(proof, path, name, as_json=line.json)
    return _CONTRADICTED if proof.counts()["contradicts"] else 0


@contextmanager
def _always_whole(record: ProofRecord, path: Path, *, as_json: bool) -> Iterator[None]:
    """Complete the report with the reason if the block ends early, and print its path."""
    try:
        yield
    except (LinkError, ReplyError, KeyboardInterrupt) as error:
        why = "it was interrupted" if isinstance(error, KeyboardInterrupt) else in_one_line(error)
        proof = record.write(why)
        complain(f"{path} has the findings so far; it ends {proof.interrupted}", as_json=as_json)
        raise


def _subject(name: DriveConfig, drive: Drive) -> ProofSubject:
    given = {key: value for key, value in name.options.items() if key != "model"}
    return ProofSubject.of(name.protocol, drive.model, given)


def _show_questions(name: DriveConfig, *, move: bool, as_json: bool) -> int:
    from drivecomm.models import load_model
    from drivecomm.protocol import installed

    known = name.options.get("model")
    plugin = installed[name.protocol]
    loaded = None if known is None else load_model(plugin.package, plugin.name, known)
    given = {key: value for key, value in name.options.items() if key != "model"}
    asked = questions(ProofSubject.of(name.protocol, loaded, given))
    if move:
        asked += [
            "with your consent: start slowly, stop, set the watchdog, start, fall silent, stop, restore the watchdog"
        ]
    for each in asked:
        tell(each, as_json=as_json, question=each)
    if not as_json:
        say(f"{counted(len(asked), 'request')}; nothing was sent")
    return 0


def _must_agree(name: DriveConfig, title: str) -> None:
    """Ask the user to type the drive's name as a safeguard. Raises UsageError for any other reply."""
    note(
        f"--move starts the motor of {name.full_name} ({title}) slowly, twice, stops it, and lets its watchdog stop "
        "it; it writes its reference and its watchdog, which is restored; keep people and objects away from the shaft"
    )
    if not sys.stdin.isatty():
        raise UsageError("--move asks for the drive's name, and there is no terminal to type it on")
    typed: str = click.prompt(f"Type {name.name} to start its motor", err=True, default="", show_default=False)
    if typed.strip() != name.name:
        raise UsageError(f"{typed.strip()!r} is not {name.name}, so nothing was started and nothing was read")


def _move(proving: Proving, drive: Any, *, as_json: bool) -> None:
    # A signal must not interrupt the stop at the end.
    with until_stopped() as stop:
        moving = Moving(proving, drive, proving.subject.model, stop.is_set)
        try:
            moving.run()
        finally:
            if not moving.is_stopped:
                complain(f"{drive.name} may be running, because its stop is not confirmed", as_json=as_json)


def _show(proof: Proof, path: Path, name: DriveConfig, *, as_json: bool) -> None:
    counts = proof.counts()
    if as_json:
        for each in proof.findings:
            if each.verdict in ("contradicts", "new"):
                emit(**labels(name), verdict=each.verdict, about=each.about, addresses=each.addresses, why=each.why)
        emit(**labels(name), file=str(path), virtual=proof.virtual, counts=dict(counts))
        return
    shown = [each for each in proof.findings if each.verdict == "contradicts"]
    for each in shown[:_MOST_SHOWN]:
        say(f"{name.name}  contradicts the model: {each.about}: {each.why}")
    if len(shown) > _MOST_SHOWN:
        say(f"  and {len(shown) - _MOST_SHOWN} more")
    for each in proof.findings:
        if each.verdict == "new":
            say(f"{name.name}  new: {each.about}: {each.why}")
    decisive = sum(each.is_decisive for each in proof.findings)
    say(
        f"{name.name}  {counts['agrees']} agree, {decisive} of them conclusively; "
        f"{counts['contradicts']} contradict, {counts['new']} new, {counts['not asked']} not asked"
    )
    say(f"written to {path}")
    if proof.virtual:
        say("the drive is a virtual one: this is not a proof of a real drive")
    elif not proof.name_plate:
        say("add what its name plate says (name_plate) before you contribute it")
