"""Command `models apply-proof`: marks of facts in a model, from the report of a proof."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, emit, say
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.models import model_paths
from drivecomm.protocol import installed
from drivecomm.proving import apply_proof, read_proof

if TYPE_CHECKING:
    from pathlib import Path

_FOLDER = "proofs"


@click.command("apply-proof", cls=CliCommand)
@click.argument("file", type=FILE, help="The report of drivecomm prove.")
@click.option("--to", type=FILE, help="The model file. Default: the one that drivecomm finds by the model's name.")
@click.option("--virtual", is_flag=True, help="Apply a proof of a virtual drive all the same, to try it out.")
@options.json
def apply(*, file: Path, to: Path | None, virtual: bool, json: bool) -> int:
    """Mark facts of a model as shown or contradicted by a drive, from a report of prove.

    Only the table [proofs] of the model file is changed, and a second run changes nothing. Exit code 1 if the drive has
    contradicted facts.
    """
    proof = read_proof(file)
    if proof.virtual and not virtual:
        raise UsageError(
            f"{file} is a proof of a virtual drive, which only repeats its model; prove a real one, or try it "
            "out with --virtual"
        )
    plugin = installed[proof.protocol]
    known = model_paths(plugin.package, plugin.name)
    if to is None and proof.model not in known:
        raise UsageError(f"{proof.protocol} has no model {proof.model!r}; name its file with --to")
    path = to or known[proof.model]
    named = f"{_FOLDER}/{file.name}" if file.resolve().parent.name == _FOLDER else file.name
    done = apply_proof(proof, named, path)
    if json:
        emit(
            file=str(path),
            raised=done.raised,
            contradicted=done.contradicted,
            unchanged=done.unchanged,
            kept=done.kept,
            stale=done.stale,
        )
        return int(bool(done.contradicted))
    for address in done.contradicted:
        say(f"{address}: contradicted by the drive; it counts as unconfirmed until the model is corrected")
    for address in done.kept:
        say(f"{address}: stays contradicted by another proof in {path.name}; correct the model, or remove that proof")
    for address in done.stale:
        say(f"{address}: left out, because the model has changed since the drive was read")
    changed = f"{len(done.raised)} raised to drive, {len(done.contradicted)} contradicted"
    say(f"{path}: {counted(len(done.raised) + len(done.contradicted), 'fact')} changed ({changed}), "
        f"{len(done.unchanged)} unchanged")  # fmt: skip
    return int(bool(done.contradicted))
