"""Contributed proofs: each is of a real drive, and still agrees with its model."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
from contributed_proofs import faults_of
from proved_drives import drive_of, model, proved

from drivecomm.proving import Proof, proof_text

FOLDER = Path(__file__).resolve().parents[2] / "proofs"
FILES = sorted(FOLDER.rglob("*.toml"))


def test_contributed_proofs_have_no_faults():
    assert {path.name: list(faults_of(path)) for path in FILES} == {path.name: [] for path in FILES}


def test_folder_of_proofs_contains_only_proofs():
    assert {path.name for path in FOLDER.iterdir()} == {"README.md", *(path.name for path in FILES)}


@pytest.fixture(scope="module")
def honest():
    known = model("vabus", "agile")
    findings = tuple(proved("vabus", known, drive_of("vabus", known)).findings)
    plate = "Bonfiglioli Agile AGL402-13 4.0 kW"
    return Proof(protocol="vabus", model="agile", date=date(2026, 11, 27), name_plate=plate, findings=findings)


def faults(proof, folder, name="vabus-agile-2026-11-27.toml"):
    path = folder / name
    path.write_text(proof_text(proof), encoding="utf-8")
    return list(faults_of(path))


def test_proof_of_a_real_drive_is_accepted(honest, tmp_path):
    assert faults(honest, tmp_path) == []


def test_proof_of_a_virtual_drive_is_refused(honest, tmp_path):
    assert faults(replace(honest, virtual=True), tmp_path) == [
        "it is of a virtual drive, which says what its model says"
    ]


def test_proof_without_a_name_plate_is_refused(honest, tmp_path):
    assert faults(replace(honest, name_plate=""), tmp_path) == [
        "name_plate does not say maker, type and rating as they are printed on the drive"
    ]


def test_proof_with_a_wrong_file_name_is_refused(honest, tmp_path):
    assert faults(honest, tmp_path, "mine.toml") == ["its name begins with vabus-agile-2026-11-27"]


def test_proof_of_a_fact_changed_in_the_model_is_refused(honest, tmp_path):
    shown = next(each for each in honest.findings if each.is_decisive and each.kind == "parameter")
    older = replace(shown, model={**shown.model, "factor": "0.5"})
    changed = replace(honest, findings=(older,))
    assert faults(changed, tmp_path) == [f"{older.about} was shown on a drive, and the model says something else now"]


def test_contradiction_that_the_model_ignores_is_refused(honest, tmp_path):
    one = next(each for each in honest.findings if each.kind == "parameter")
    against = replace(one, verdict="contradicts", why="the drive refused it with code 11: unknown", shows=())
    (text,) = faults(replace(honest, findings=(against,)), tmp_path)
    assert text.startswith(f"{one.about} was contradicted by a drive, and the model still says it")
