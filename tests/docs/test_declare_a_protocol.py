"""The protocol package of the page "Declare a protocol", installed from the page, checked and used."""

import subprocess
import sys

import pytest
from forked import Forked
from packages_of_pages import installed_from
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "development" / "declare-a-protocol.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return installed_from(PAGE, tmp_path_factory.mktemp("declared"))


@pytest.fixture
def run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "200")
    return lambda *arguments: Forked(arguments, [str(folder)]).end()


def test_vectors_and_model_of_the_package_pass_every_check(run):
    code, output = run("vectors", "check", "drivecomm_toy/vectors.toml")
    assert (code, output.splitlines()[-1].endswith(" 0 failed")) == (0, True), output
    code, output = run("models", "check", "drivecomm_toy/models/t1.toml")
    assert code == 0, output


@pytest.mark.soak
def test_package_passes_the_conformance_kit(run):
    code, output = run("conformance", "toy")
    assert code == 0, output


def test_drive_of_the_package_is_started_and_stopped(folder):
    program = (
        "import drivecomm; from drivecomm.virtual import VirtualLine, virtual_drive\n"
        "line = VirtualLine([virtual_drive('toy', 4)])\n"
        "with drivecomm.open_bus(line.port) as bus:\n"
        "    drive = bus.drive('toy', 4, model='t1')\n"
        "    drive.set_reference(hz=30)\n"
        "    drive.start(reverse=True)\n"
        "    line.advance(10)\n"
        "    status = drive.status()\n"
        "    print(drive.read('output_frequency'), status.state.value, status.reverse, status.at_reference)\n"
        "    drive.stop()\n"
        "    line.advance(10)\n"
        "    print(drive.status().state.value)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": str(folder), "PATH": ""},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout == "30.0 Hz running True True\nready\n", done.stderr


def test_package_passes_mypy_strict(folder):
    pytest.importorskip("mypy")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", "mypy", "drivecomm_toy"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_package_imports_only_allowed_modules_and_is_short():
    code = next(block.code for block in blocks_of(PAGE) if block.title.endswith("__init__.py"))
    imported = {line.split()[1] for line in code.splitlines() if line.startswith("from drivecomm.")}
    assert imported <= {"drivecomm.protocol", "drivecomm.protocol.schema", "drivecomm.profiles", "drivecomm.errors"}
    assert len(code.splitlines()) <= 160
