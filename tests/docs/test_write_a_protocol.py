"""The protocol package of the page "Write a protocol package", installed from the page and used end to end."""

import os
import subprocess
import sys

import pytest
from console import Console, must_match
from forked import Forked
from packages_of_pages import installed_from
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "development" / "write-a-protocol.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the package and its metadata, laid out as by an installer."""
    return installed_from(PAGE, tmp_path_factory.mktemp("toy"))


@pytest.fixture
def run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments):
        return Forked(arguments, [str(folder)]).end()

    return run


@pytest.fixture
def run_python(folder, monkeypatch):
    monkeypatch.chdir(folder)
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(*arguments):
        return subprocess.run(
            [sys.executable, *arguments],
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    return run


def test_package_is_listed_with_its_model(run):
    _, output = run("protocols", "--json")
    assert '"protocol": "toy", "title": "Toy drive"' in output
    assert '"models": ["t1"]' in output


def test_vectors_of_the_package_pass_every_check(run):
    code, output = run("vectors", "check", "drivecomm_toy/vectors.toml")
    assert code == 0, output
    assert output.endswith(" 0 failed\n")


@pytest.mark.soak
def test_package_passes_the_conformance_kit(run):
    code, output = run("conformance", "toy", "--quick")
    assert code == 0, output


@pytest.mark.soak
def test_commands_of_the_page_run(run, folder):
    """Run decode, encode, and a simulator that is scanned and read."""
    block = next(block for block in blocks_of(PAGE) if block.language == "console" and "decode" in block.code)
    with Console(lambda arguments: run(*arguments), [str(folder)]) as console:
        console.play(block)


def test_program_of_the_page_runs(run_python):
    """The program scans, writes, reads, starts, stops, trips and resets on a virtual line, beside a VABus drive."""
    blocks = list(blocks_of(PAGE))
    program = next(block for block in blocks if block.language == "python" and not block.title)
    shown = next(block for block in blocks if block.remark == "prints")
    done = run_python("-c", program.code)
    assert done.returncode == 0, done.stderr
    must_match(shown.code, done.stdout, PAGE)


def test_protocol_page_of_the_package_is_generated(run_python):
    """The generator draws the telegrams of any installed protocol, including third-party ones."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import protocol_pages\n"
        "from drivecomm.protocol.registry import installed\n"
        "print(protocol_pages.protocol_page(installed['toy']))"
    )
    done = run_python("-c", code, str(ROOT / "docs"))
    assert done.returncode == 0, done.stderr
    assert "# Toy drive" in done.stdout
    assert "| > | address | kind | parameter | data | XOR |" in " ".join(done.stdout.split())
    assert "`output_frequency`" in done.stdout


def test_package_imports_only_the_protocol_contract():
    allowed = {"drivecomm.protocol", "drivecomm.protocol.schema", "drivecomm.errors"}
    for block in blocks_of(PAGE):
        if block.title.endswith(".py"):
            imported = {line.split()[1] for line in block.code.splitlines() if line.startswith("from drivecomm.")}
            assert imported <= allowed, block.title
