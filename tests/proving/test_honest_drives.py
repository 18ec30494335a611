"""Proofs of drives that match their model: no contradiction, no write, no motion."""

import pytest
from proved_drives import all_models, contradictions, drive_of, proved

import drivecomm
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.protocol import Refusal, installed
from drivecomm.proving import ProofSubject, Proving
from drivecomm.virtual import VirtualLine

MODELS = all_models()


def held(drive, known):
    """Return the drive's values of all writable parameters."""
    found = {}
    for info in known.parameters.values():
        if "w" in info.access:
            try:
                found[info.address] = drive.peek(info.address, 0.0)
            except (DriveCommError, Refusal):
                continue
    return found


@pytest.mark.parametrize("name", sorted(MODELS))
def test_proof_of_an_honest_drive_contradicts_and_writes_nothing(name):
    """The proof has a finding for each parameter of the model."""
    known = MODELS[name]
    drive = drive_of(known.protocol, known)
    before = held(drive, known)
    proving = proved(known.protocol, known, drive)
    assert [f"{each.about}: {each.why}" for each in contradictions(proving)] == []
    assert proving.at == ""
    assert (drive.counts["writes"], drive.counts["commands"], drive.counts["turns"]) == (0, 0, 0)
    assert drive.counts["asks"] > 0
    assert held(drive, known) == before
    told = {each.addresses[0] for each in proving.findings if each.kind == "parameter"}
    assert told == known.parameters.keys()


@pytest.mark.parametrize("name", sorted(installed))
def test_every_installed_protocol_has_a_model_in_these_tests(name):
    assert any(each.startswith(f"{name}/") for each in MODELS)
    assert f"{name}/{installed[name].default_model}" in MODELS


def test_drive_that_is_not_read_only_is_not_proved():
    known = MODELS["vabus/agile"]
    line = VirtualLine([drive_of("vabus", known)])
    with drivecomm.open_bus(line.port) as bus:
        armed = bus.drive("vabus", 1, model=known)
        with pytest.raises(UsageError, match="a proof needs a read-only drive"):
            Proving(armed, ProofSubject.of("vabus", known, {})).run()
    assert line.time == 0.0
