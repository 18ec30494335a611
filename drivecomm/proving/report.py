"""Proofs as TOML files, for people and for version control."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from datetime import date
from decimal import Decimal
from typing import TYPE_CHECKING, Any, get_args

from drivecomm.proving.findings import Kind, ProofFinding, Shown, Verdict
from drivecomm.tomlfile import CHOICE, LIST, TABLE, TABLES, TEXT, WHOLE, Kind as KeyKind, read_toml, toml_line
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

FORMAT = 1

_HEAD = """\
# Values of a drive, compared with its drivecomm model: docs/how-to/contribute-a-proof.md explains each key.
"""
_TOP: Mapping[str, KeyKind] = {
    "format": WHOLE,
    "protocol": TEXT,
    "model": TEXT,
    "drivecomm": TEXT,
    "date": KeyKind((date,), "a date, such as 2026-11-27"),
    "name_plate": TEXT,
    "virtual": CHOICE,
    "moved": CHOICE,
    "interrupted": TEXT,
    "options": TABLE,
    "identity": TABLE,
    "counts": TABLE,
    "fact": TABLES,
}
_FACT: Mapping[str, KeyKind] = {
    "about": TEXT,
    "kind": TEXT,
    "verdict": TEXT,
    "why": TEXT,
    "addresses": LIST,
    "shows": LIST,
    "model": TABLE,
    "drive": TABLE,
}
_WORDS = {"kind": get_args(Kind), "verdict": get_args(Verdict)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Content of a proof file.

    name_plate: what a person has read on the drive. virtual: whether the drive is known to be virtual; an undetected
    one is possible. moved: whether the motor was started. interrupted: at which request and why; empty for a complete
    proof. options: the drive's options beyond its model's. identity: type and firmware as reported by the drive.
    """

    protocol: str
    model: str
    drivecomm: str = __version__
    date: date
    name_plate: str = ""
    virtual: bool = False
    moved: bool = False
    interrupted: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    identity: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[ProofFinding, ...] = ()

    def counts(self) -> Counter[Verdict]:
        """Return the number of findings by verdict."""
        return Counter(each.verdict for each in self.findings)


def proof_text(proof: Proof) -> str:
    """Return the text of a proof file."""
    head = {"format": FORMAT, "protocol": proof.protocol, "model": proof.model, "drivecomm": proof.drivecomm}
    head |= {"date": proof.date, "name_plate": proof.name_plate, "virtual": proof.virtual, "moved": proof.moved}
    head |= {"interrupted": proof.interrupted}
    counts = proof.counts()
    tables: dict[str, Mapping[str, Any]] = {
        "options": proof.options,
        "identity": proof.identity,
        "counts": {verdict: counts[verdict] for verdict in get_args(Verdict)},
    }
    parts = [_HEAD + _lines(head)]
    parts += [f"[{name}]\n{_lines(table)}" for name, table in tables.items() if table]
    order = {"contradicts": 0, "new": 1, "agrees": 2, "not asked": 3}
    parts += [
        f"[[fact]]\n{_lines(_keys(each))}" for each in sorted(proof.findings, key=lambda each: order[each.verdict])
    ]
    return "\n".join(parts)


def read_proof(path: Path) -> Proof:
    """Read a proof file. Raises FileFormatError with the line and the key for an invalid proof."""
    top = read_toml(path, "a proof")
    given = top.take(_TOP, "format", "protocol", "model", "drivecomm", "date")
    if given.pop("format") != FORMAT:
        raise top.error(f"is not a proof of this format; it begins with format = {FORMAT}", "format")
    given.pop("counts", None)
    given.pop("fact", None)
    return Proof(**given, findings=tuple(_findings(top)))


def _findings(top: TomlTable) -> Iterator[ProofFinding]:
    for table in top.tables("fact"):
        given = table.take(_FACT, "about", "kind", "verdict")
        for key, words in _WORDS.items():
            if given[key] not in words:
                raise table.error(f"{key} is {given[key]!r}, and must be one of {', '.join(words)}", key)
        shown = given.get("shows", [])
        if not set(shown) <= set(get_args(Shown)):
            raise table.error(f"shows has one or more of {', '.join(get_args(Shown))}", "shows")
        places = given.get("addresses", [])
        if not all(isinstance(each, str) for each in places):
            raise table.error("addresses are texts", "addresses")
        yield ProofFinding(**{**given, "addresses": tuple(places), "shows": tuple(shown)})


def _keys(finding: ProofFinding) -> dict[str, Any]:
    keys: dict[str, Any] = {"about": finding.about, "kind": finding.kind, "verdict": finding.verdict}
    keys |= {"why": finding.why, "addresses": finding.addresses, "shows": finding.shows}
    keys |= {"model": finding.model, "drive": finding.drive}
    return {key: value for key, value in keys.items() if value}


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{toml_line(key, proof_value(value))}\n" for key, value in table.items())


def proof_value(value: Any) -> Any:
    """Return a value in the types of a proof file: exact numbers become texts, to keep their digits."""
    if isinstance(value, Decimal):
        return f"{value:f}"
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): proof_value(each) for key, each in value.items()}
    return [proof_value(each) for each in value] if isinstance(value, list | tuple) else value
