"""Application of a proof: marks facts in the model file, keeps everything else unchanged, and works only once."""

import tomllib
from dataclasses import replace
from datetime import date

import pytest

import drivecomm
from drivecomm.bus import policies
from drivecomm.cli import main
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import check_model, contradicted, model_text, read_model
from drivecomm.proving import Proof, ProofFinding, apply_proof, proof_text, read_proof
from drivecomm.virtual import VirtualLine, virtual_drive

MODEL = """\
# My mill, written by hand.
format = 1
protocol = "modbus"
name = "mill"
source = "manual p. 1"

[options]
register_base = 1   # as the manual counts

[control]
start = [["1", 1]]
stop = [["1", 0]]
[control.status]
running = ["3", 1, 1]

[watchdog]
time = "5"
actions = { trip = 0 }
off = 0

[[parameter]]
address = "1"     # bit 0 runs
name = "orders"
type = "u16"
kind = "command"

[[parameter]]
address = "3"
name = "state"
type = "u16"
access = "r"

[[parameter]]
address = "4"
name = "rated_frequency"
type = "u16"
unit = "Hz"
factor = "0.01"
sure = "unconfirmed"

[[parameter]]
address = "5"
name = "silence_time"
type = "u16"
unit = "s"
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mill.toml"
    path.write_text(MODEL, encoding="utf-8")
    return path


def said(file, address):
    from drivecomm.proving.parameters import model_facts

    return model_facts(read_model(file, "modbus", "").parameters[address])


def finding(file, address, verdict="agrees", shows=("scale",), **keys):
    given = {"about": f"parameter {address}", "addresses": (address,), "model": said(file, address), **keys}
    return ProofFinding(kind="parameter", verdict=verdict, shows=shows, **given)


def proof_of(*findings):
    return Proof(protocol="modbus", model="mill", date=date(2026, 11, 27), findings=findings)


def marks(file):
    return {address: each["sure"] for address, each in tomllib.loads(file.read_text())["proofs"].items()}


def test_proven_fact_gets_the_mark_drive_and_the_file_keeps_its_layout(file):
    done = apply_proof(proof_of(finding(file, "4")), "proofs/mill.toml", file)
    assert done.raised == ["4"]
    info = read_model(file, "modbus", "").parameters["4"]
    assert (info.sure, info.proof, info.source) == ("drive", "proofs/mill.toml", "")
    text = file.read_text(encoding="utf-8")
    assert text.replace('\n[proofs]\n4 = {sure = "drive", proof = "proofs/mill.toml"}\n', "") == MODEL
    assert check_model(file) == []


def test_applying_a_proof_twice_changes_nothing(file):
    proof = proof_of(finding(file, "4"), finding(file, "5", "contradicts", ()))
    apply_proof(proof, "proofs/mill.toml", file)
    before = file.read_bytes(), file.stat().st_mtime_ns
    done = apply_proof(proof, "proofs/mill.toml", file)
    assert (done.raised, done.contradicted, done.unchanged) == ([], [], ["4", "5"])
    assert (file.read_bytes(), file.stat().st_mtime_ns) == before


def test_proof_of_existence_alone_raises_no_fact(file):
    done = apply_proof(proof_of(finding(file, "4", shows=("exists",))), "p.toml", file)
    assert done.raised == []
    assert file.read_text(encoding="utf-8") == MODEL


def test_contradiction_outweighs_agreement_and_later_proofs(file):
    said_then = {"4": said(file, "4")}
    plate = ProofFinding(
        kind="name plate", verdict="contradicts", about="x", addresses=("4",), model=said_then, why="5 Hz"
    )
    assert apply_proof(proof_of(finding(file, "4"), plate), "p.toml", file).contradicted == ["4"]
    assert apply_proof(proof_of(finding(file, "4")), "q.toml", file).kept == ["4"]
    assert marks(file) == {"4": "contradicted"}


def test_later_contradiction_replaces_the_mark_drive(file):
    apply_proof(proof_of(finding(file, "4")), "p.toml", file)
    assert apply_proof(proof_of(finding(file, "4", "contradicts", ())), "q.toml", file).contradicted == ["4"]
    assert marks(file) == {"4": "contradicted"}


def test_fact_changed_since_the_proof_is_stale(file):
    proof = proof_of(finding(file, "4"))
    file.write_text(MODEL.replace('"0.01"', '"0.1"'), encoding="utf-8")
    done = apply_proof(proof, "p.toml", file)
    assert (done.raised, done.stale) == ([], ["4"])


def test_proof_of_another_model_is_refused(file):
    with pytest.raises(UsageError, match="the proof is of model pump"):
        apply_proof(replace(proof_of(), model="pump"), "p.toml", file)


def test_contradicted_command_is_reported_and_refused(file):
    apply_proof(proof_of(finding(file, "1", "contradicts", ())), "p.toml", file)
    assert [each.key for each in check_model(file)] == ["1"]
    assert "a command or the status rests on 1, which a drive has contradicted" in str(check_model(file)[0])
    drive = virtual_drive("modbus", 1, model=file)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        mill = bus.drive("modbus", 1, model=file)
        for verb in (mill.start, lambda: mill.write("5", 3)):
            with pytest.raises(UsageError, match="which a drive has contradicted"):
                verb()
        mill.read("4")
        assert not drive.motor.running
        mill.stop()


def test_contradicted_watchdog_offers_no_policy(file):
    loss = ProofFinding(
        kind="link loss",
        verdict="contradicts",
        about="x",
        addresses=("5",),
        model={"time": "5", "actions": {"trip": 0}, "off": 0},
    )
    assert policies(read_model(file, "modbus", "")) == ("hold", "trip")
    assert apply_proof(proof_of(loss), "p.toml", file).contradicted == ["watchdog"]
    model = read_model(file, "modbus", "")
    assert contradicted(model) == ["the watchdog"]
    assert policies(model) == ()


def test_extending_model_inherits_only_contradictions(file, tmp_path):
    apply_proof(proof_of(finding(file, "4"), finding(file, "5", "contradicts", ())), "p.toml", file)
    other = tmp_path / "other.toml"
    other.write_text('format = 1\nprotocol = "modbus"\nname = "other"\nextends = "mill"\n', encoding="utf-8")
    model = read_model(other, "modbus", "")
    assert {address: model.parameters[address].sure for address in ("4", "5")} == {
        "4": "unconfirmed",
        "5": "contradicted",
    }


def test_proved_model_survives_a_write_and_read(file, tmp_path):
    apply_proof(proof_of(finding(file, "4"), finding(file, "5", "contradicts", ())), "p.toml", file)
    model = read_model(file, "modbus", "")
    written = tmp_path / "written.toml"
    written.write_text(model_text(model), encoding="utf-8")
    assert read_model(written, "modbus", "") == model


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ('9 = { sure = "drive", proof = "p.toml" }', "there is no parameter '9'"),
        ('4 = { sure = "printed", proof = "p.toml" }', "sure is one of drive, contradicted"),
        ('4 = "drive"', "says what a proof has shown"),
        ('4 = { sure = "drive", proof = "" }', "proof names the report"),
    ],
)
def test_model_check_finds_invalid_marks(file, table, text):
    file.write_text(f"{MODEL}\n[proofs]\n{table}\n", encoding="utf-8")
    (found,) = check_model(file)
    assert text in str(found)
    assert found.line == MODEL.count("\n") + 3


def test_mark_drive_without_a_proof_is_refused(file):
    file.write_text(MODEL.replace('"unconfirmed"', '"drive"'), encoding="utf-8")
    (found,) = check_model(file)
    assert "invalid value 'drive'" in str(found)


def test_command_applies_a_proof_and_prints_the_changes(file, tmp_path, capsys):
    report = tmp_path / "report.toml"
    report.write_text(proof_text(proof_of(finding(file, "4"), finding(file, "5", "contradicts", ()))), encoding="utf-8")
    assert main(["models", "apply-proof", str(report), "--to", str(file)]) == 1
    out = capsys.readouterr().out
    assert "5: contradicted by the drive; it counts as unconfirmed until the model is corrected\n" in out
    assert out.endswith("2 facts changed (1 raised to drive, 1 contradicted), 0 unchanged\n")
    assert main(["models", "apply-proof", str(report), "--to", str(file)]) == 0
    assert main(["models", "check", str(file)]) == 0
    assert "in order; a drive has contradicted 5, which counts as unconfirmed\n" in capsys.readouterr().out


def test_command_refuses_a_proof_of_a_virtual_drive(file, tmp_path, capsys):
    report = tmp_path / "report.toml"
    report.write_text(proof_text(replace(proof_of(finding(file, "4")), virtual=True)), encoding="utf-8")
    assert main(["models", "apply-proof", str(report), "--to", str(file)]) == 2
    assert "is a proof of a virtual drive" in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == MODEL
    assert main(["models", "apply-proof", str(report), "--to", str(file), "--virtual"]) == 0


def test_proof_file_survives_a_write_and_read(file, tmp_path):
    report = tmp_path / "report.toml"
    proof = proof_of(finding(file, "4", drive={"value": "50.00 Hz"}, why=""))
    report.write_text(proof_text(proof), encoding="utf-8")
    assert proof_text(read_proof(report)) == proof_text(proof)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('verdict = "agrees"', 'verdict = "maybe"', "verdict is 'maybe', and must be one of"),
        ("format = 1", "format = 2", "is not a proof of this format"),
        ('kind = "parameter"', 'knd = "parameter"', "unknown key 'knd'"),
        ('shows = ["scale"]', 'shows = ["all"]', "shows has one or more of"),
    ],
)
def test_invalid_proof_file_raises_file_format_error(file, tmp_path, old, new, text):
    report = tmp_path / "report.toml"
    report.write_text(proof_text(proof_of(finding(file, "4"))).replace(old, new), encoding="utf-8")
    with pytest.raises(FileFormatError, match=text):
        read_proof(report)
