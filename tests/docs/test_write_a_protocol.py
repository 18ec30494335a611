"""The protocol package on the page "Write a protocol package", installed from the page and used end to end."""

import os
import subprocess
import sys
import tomllib

import pytest
from console import Console, must_match
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "development" / "write-a-protocol.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the package and its metadata, as an installer would leave them."""
    folder = tmp_path_factory.mktemp("toy")
    for block in blocks_of(PAGE):
        if block.title:
            place = folder / block.title
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(block.code, encoding="utf-8")
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    metadata = folder / f"drivecomm_toy-{project['version']}.dist-info"
    metadata.mkdir()
    heading = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (metadata / "METADATA").write_text(heading, encoding="utf-8")
    points = project["entry-points"]["drivecomm.protocols"]
    lines = ["[drivecomm.protocols]", *(f"{name} = {value}" for name, value in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


@pytest.fixture
def environment(folder):
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, "PYTHONPATH": path, "COLUMNS": "200"}


@pytest.fixture
def run(folder, environment, monkeypatch):
    monkeypatch.chdir(folder)

    def run(*arguments):
        return subprocess.run(
            [sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=60, check=False
        )

    return run


def test_it_is_listed_with_its_model(run):
    done = run("-m", "drivecomm", "protocols", "--json")
    assert '"protocol": "toy", "title": "Toy drive"' in done.stdout
    assert '"models": ["t1"]' in done.stdout


def test_its_vectors_pass_every_check(run):
    done = run("-m", "drivecomm", "vectors", "check", "drivecomm_toy/vectors.toml")
    assert done.returncode == 0, done.stdout
    assert done.stdout.endswith(" 0 failed\n")


def test_it_stands_the_conformance_kit(run):
    done = run("-m", "drivecomm", "conformance", "toy", "--quick")
    assert done.returncode == 0, done.stdout


def test_commands_of_the_page(run, environment):
    """Decode, encode, and a simulator that is scanned and read."""

    def command(arguments):
        done = run("-m", "drivecomm", *arguments)
        return done.returncode, done.stdout + done.stderr

    block = next(block for block in blocks_of(PAGE) if block.language == "console" and "decode" in block.code)
    with Console(command, environment) as console:
        console.play(block)


def test_program_of_the_page(run):
    """Scan, write, read, start, stop, trip and reset on a virtual line, beside a VABus drive."""
    blocks = list(blocks_of(PAGE))
    program = next(block for block in blocks if block.language == "python" and not block.title)
    shown = next(block for block in blocks if block.remark == "prints")
    done = run("-c", program.code)
    assert done.returncode == 0, done.stderr
    must_match(shown.code, done.stdout, PAGE)


def test_its_page_is_generated(run):
    """The documentation draws the telegrams of a protocol that drivecomm has never heard of."""
    pytest.importorskip("mkdocs", reason="the pages need the extra named docs")
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import generate\n"
        "from drivecomm.protocol.registry import installed\n"
        "print(generate.protocol_page(installed['toy']))"
    )
    done = run("-c", code, str(ROOT / "docs"))
    assert done.returncode == 0, done.stderr
    assert "# Toy drive" in done.stdout
    assert "| > | address | kind | parameter | data | XOR |" in " ".join(done.stdout.split())
    assert "`output_frequency`" in done.stdout


def test_it_knows_only_the_contract():
    allowed = {"protocol", "protocol.schema", "errors"}
    for block in blocks_of(PAGE):
        if block.title.endswith(".py"):
            imported = {line.split()[1] for line in block.code.splitlines() if line.startswith("from drivecomm.")}
            assert imported <= {f"drivecomm.{name}" for name in allowed}, block.title
