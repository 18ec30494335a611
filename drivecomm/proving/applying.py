"""Application of a proof to its model: writes the table [proofs] of the model file, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import read_model
from drivecomm.protocol import WATCHDOG_PROOF, installed
from drivecomm.proving.link_loss import watchdog_facts
from drivecomm.proving.parameters import model_facts
from drivecomm.proving.report import proof_value
from drivecomm.tomlfile import read_text_file, write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.protocol import Model, Sureness
    from drivecomm.proving.findings import ProofFinding
    from drivecomm.proving.report import Proof


@dataclass(slots=True)
class AppliedMarks:
    """Effect of a proof on the facts of its model, by address.

    raised, contradicted: facts that were given this mark. unchanged: facts that had the mark before. kept: facts that
    keep the mark `contradicted` from another proof. stale: facts that have changed in the model since the proof.
    """

    raised: list[str] = field(default_factory=list)
    contradicted: list[str] = field(default_factory=list)
    unchanged: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    stale: list[str] = field(default_factory=list)


def marks_of(proof: Proof, model: Model) -> dict[str, Sureness]:
    """Return the marks that a proof gives the facts of its model, by address; stale facts get none.

    A fact is raised to `drive` by an answer that would differ if the fact were wrong. It is marked `contradicted` by
    any contradicting answer, even if other answers agree.
    """
    marks: dict[str, Sureness] = {}
    for finding in proof.findings:
        if finding.is_decisive and not is_stale(finding, model):
            marks |= dict.fromkeys(_facts(finding, model), "drive")
    for finding in proof.findings:
        if finding.verdict == "contradicts" and not is_stale(finding, model):
            marks |= dict.fromkeys(_facts(finding, model), "contradicted")
    return marks


def is_stale(finding: ProofFinding, model: Model) -> bool:
    """Whether the model has changed since the finding was made."""
    if not finding.addresses:
        return False
    if finding.kind == "link loss":
        return bool(proof_value(watchdog_facts(model)) != proof_value(finding.model))
    said = finding.model if finding.kind == "name plate" else {finding.addresses[0]: finding.model}
    return any(not _still_says(model, address, fact) for address, fact in said.items())


def _still_says(model: Model, address: str, fact: Any) -> bool:
    info = model.parameters.get(address)
    return info is not None and proof_value(model_facts(info)) == proof_value(fact)


def apply_proof(proof: Proof, named: str, file: Path) -> AppliedMarks:
    """Write the marks of a proof into a model's file; comments and layout stay. named: name of the proof in the marks.

    Applying the same proof again changes nothing. Raises UsageError for a proof of another model, and FileFormatError
    for a file that cannot be read or written.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    plugin = installed[proof.protocol]
    model = read_model(file, plugin.name, plugin.package)
    if model.name != proof.model:
        raise UsageError(f"the proof is of model {proof.model}, and {file} is model {model.name}")
    text = read_text_file(file, "a model")
    try:
        document: Any = tomlkit.parse(text)
    except TOMLKitError as error:
        raise FileFormatError(f"{file}: cannot be read as a model: {error}") from error
    applied = AppliedMarks(stale=list(_stale(proof, model)))
    table = document.get("proofs")
    new = {} if table is None else dict(table)
    for address, mark in marks_of(proof, model).items():
        before = new.get(address, {})
        if before.get("sure") == mark:
            applied.unchanged.append(address)
        elif before.get("sure") == "contradicted":
            applied.kept.append(address)
        else:
            (applied.raised if mark == "drive" else applied.contradicted).append(address)
            if table is None:
                table = document["proofs"] = tomlkit.table()
            entry = tomlkit.inline_table()
            entry.update({"sure": mark, "proof": named})
            table[address] = entry
    if applied.raised or applied.contradicted:
        write_atomically(file, tomlkit.dumps(document))
    return applied


def disagreements(proof: Proof, model: Model) -> Iterator[str]:
    """Yield the disagreements of a proof with its present model, as sentences.

    A proven fact must be unchanged; a contradicted fact must be changed, or marked as contradicted.
    """
    for finding in proof.findings:
        if finding.is_decisive and is_stale(finding, model):
            yield f"{finding.about} was shown on a drive, and the model says something else now"
        if finding.verdict == "contradicts" and not is_stale(finding, model):
            for address in _facts(finding, model):
                if _mark(model, address) != "contradicted":
                    yield f"{finding.about} was contradicted by a drive, and the model still says it: {finding.why}"


def _mark(model: Model, address: str) -> str:
    proved = model.proofs.get(address)
    return "" if proved is None else proved.sure


def _stale(proof: Proof, model: Model) -> Iterator[str]:
    for finding in proof.findings:
        if (finding.is_decisive or finding.verdict == "contradicts") and is_stale(finding, model):
            yield finding.addresses[0] if finding.addresses else finding.about


def _facts(finding: ProofFinding, model: Model) -> Iterator[str]:
    """Yield the keys in [proofs] of the facts that a finding is about."""
    if finding.kind == "link loss":
        if model.watchdog is not None:
            yield WATCHDOG_PROOF
        return
    for address in finding.addresses:
        whole = address if address in model.parameters else address.partition("[")[0]
        if whole in model.parameters:
            yield whole
