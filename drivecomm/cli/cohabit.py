"""Command `cohabit`: check whether drives on one line can take each other's telegrams for their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import emit, plain, say
from drivecomm.cli.values import FILE, Number
from drivecomm.errors import UsageError
from drivecomm.plant import read_plant
from drivecomm.protocol import parse_drive
from drivecomm.traffic.cohabitation import check_line

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from drivecomm.traffic.cohabitation import Cohabitation, MistakeProof, PairVerdict


@click.command(cls=CliCommand)
@click.argument("plant", type=FILE, required=False, help="Plant file (.toml) with lines and drives.")
@click.option(
    "--drive", "-d", metavar="DRIVE", multiple=True, help="PROTOCOL:ADDRESS[,baudrate=...,parity=...]; repeatable."
)
@click.option(
    "--bits",
    type=Number(int, "a whole number", at_least=1),
    help="Accept mix-ups that chance produces in fewer than one of 2^BITS telegrams.",
)
@options.json
def cohabit(*, plant: Path | None, drive: tuple[str, ...], bits: int | None, json: bool) -> int:
    """Check whether drives on one line can mistake each other's telegrams for their own, with proof.

    Opens no port. Exit code 1 when a drive can, or when that cannot be ruled out.
    """
    if (plant is None) == (not drive):
        raise UsageError("give a plant file, or the drives of one line with --drive")
    if plant is None:
        lines = {"": [parse_drive(text) for text in drive]}
    else:
        known = read_plant(plant)
        lines = {line.name: [line.reached(one) for one in known.on_line(line.name)] for line in known.lines}
    if not any(len(drives) > 1 for drives in lines.values()):
        raise UsageError("a single drive cannot be mistaken for another; name two or more with --drive")
    passed = True
    for name, drives in lines.items():
        found = check_line(drives)
        passed = passed and all(_passes(verdict, bits) for verdict in found.drives)
        if json:
            _emit(name, found)
        else:
            _tell(name, found)
    return 0 if passed else 1


def _passes(verdict: PairVerdict, bits: int | None) -> bool:
    chance = verdict.proof.bits if verdict.proof is not None else None
    return verdict.safe or (bits is not None and chance is not None and chance > bits)


def _emit(line: str, found: Cohabitation) -> None:
    for who, verdicts in (("drive", found.drives), ("master", found.master)):
        for verdict in verdicts:
            emit(line=line, who=who, **plain(verdict))
    emit(line=line, safe=found.safe, advice=found.advice)


def _tell(line: str, found: Cohabitation) -> None:
    if line:
        say(f"Line {line}")
    say("Telegrams that each drive can mistake for its own:")
    _tell_each(found.drives)
    say()
    say("Late replies of other drives that the master can mistake for the one it waits for:")
    _tell_each(found.master)
    say()
    for sentence in found.advice:
        say(sentence)


def _tell_each(verdicts: Sequence[PairVerdict]) -> None:
    for verdict in verdicts:
        say(f"  {verdict.listener} hears {verdict.speaker}: {verdict.outcome.value}")
        say(f"    {verdict.reason}")
        if verdict.proof is not None:
            _tell_proof(verdict.proof)


def _tell_proof(proof: MistakeProof) -> None:
    for telegram in proof.telegrams:
        say(f"    {telegram.direction:8} {telegram.data.hex(' ').upper()}")
        if telegram.heard != telegram.data:
            say(f"    as heard {telegram.heard.hex(' ').upper()}")
    say(f"    taken    {proof.taken.hex(' ').upper()}")
    content = " ".join(f"{name}={value}" for name, value in proof.fields.items())
    chance = "" if proof.bits is None else f"; by chance in one of 2^{proof.bits} such telegrams"
    say(f"    which is {content}{chance}")
