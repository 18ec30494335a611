"""Files that commands write: never replaced without --force, and errors are reported before work begins."""

import os
from pathlib import Path

import pytest

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "line"
[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
[[door]]
kind = "modbus-tcp"
listen = "127.0.0.1:0"
units = {{ pump = 1 }}
"""

COMMANDS = {
    "scan": ["scan", "--protocol", "vabus", "-a", "1", "--port", "line", "--write", "FILE.toml"],
    "models grow": ["models", "grow", "vabus:1", "480", "--port", "line", "--write", "FILE.toml"],
    "sniff": ["sniff", "heard.jsonl", "--write", "FILE.jsonl"],
    "plot": ["plot", "values.csv", "-o", "FILE.svg"],
    "registers": ["serve", "plant.toml", "--registers", "--csv", "FILE.csv"],
    "conformance": ["conformance", "vabus", "--quick", "--only", "address", "--html", "FILE.html"],
    "vectors from-capture": ["vectors", "from-capture", "heard.jsonl", "--protocol", "vabus", "--output", "FILE.toml"],
}


@pytest.fixture
def folder(shell, tmp_path, monkeypatch):
    """Create the files that the commands read in the current folder; return the line."""
    line = shell.line(virtual_drive("vabus", 1))
    monkeypatch.chdir(tmp_path)
    words = ["poll", "vabus:1,model=agile", "480", "--cycles", "2", "--log", "values.csv", "--record", "heard.jsonl"]
    assert shell(*words) == 0
    Path("plant.toml").write_text(PLANT.format(), encoding="utf-8")
    return line


def named(words, name):
    return [word.replace("FILE", name) for word in words]


@pytest.mark.parametrize("name", COMMANDS)
def test_existing_file_is_replaced_only_with_force(shell, folder, name):
    words = named(COMMANDS[name], "there")
    file = Path(next(word for word in words if word.startswith("there")))
    file.write_text("mine", encoding="utf-8")
    before = folder.time
    assert shell(*words, port=None) == 2
    assert shell.err == f"drivecomm: {file} exists already; name another file, or write --force to replace it\n"
    assert (file.read_text(encoding="utf-8"), folder.time) == ("mine", before)
    assert shell(*words, "--force", port=None) == 0
    assert file.stat().st_size > 4


@pytest.mark.parametrize("name", COMMANDS)
def test_missing_folder_is_reported_before_anything_is_sent(shell, folder, name):
    before = folder.time
    assert shell(*named(COMMANDS[name], "nowhere/there"), port=None) == 2
    assert "there is no folder nowhere; make it first" in shell.err
    assert folder.time == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no such device")
@pytest.mark.parametrize("name", ["scan", "sniff"])
def test_full_disk_is_reported_before_anything_is_sent(shell, folder, name, monkeypatch):
    def full(*_, **__):
        return Path("/dev/full").open("wb", buffering=0)

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    before = folder.time
    assert shell(*named(COMMANDS[name], "there"), port=None) == 2
    assert "cannot be written: No space left on device" in shell.err
    assert folder.time == before


@pytest.mark.usefixtures("folder")
def test_force_without_a_file_is_refused(shell):
    for words in (["serve", "plant.toml", "--registers"], ["sniff", "heard.jsonl"], ["history"]):
        assert shell(*words, "--force", port=None) == 2
        assert "--force has no effect without " in shell.err


def test_unwritable_backup_is_reported_before_anything_is_sent(shell, folder):
    before = folder.time
    assert shell("backup", "vabus:1,model=agile", "/proc/pump.toml") == 2
    assert "/proc/pump.toml: cannot be written: " in shell.err
    assert folder.time == before


@pytest.mark.usefixtures("folder")
def test_existing_recording_is_replaced_only_by_a_stop(shell):
    file = Path("heard.jsonl")
    content = file.read_bytes()
    for command in (["read", "vabus:1", "480"], ["reset", "vabus:1"]):
        assert shell(*command, "--record", str(file)) == 2
        assert shell.err == f"drivecomm: {file} exists already; name another file, or remove it\n"
    assert file.read_bytes() == content
    assert shell("stop", "vabus:1", "--record", str(file)) == 0
    assert file.read_bytes() != content


@pytest.mark.skipif(os.name != "posix", reason="there is no such device")
@pytest.mark.usefixtures("folder")
def test_device_is_refused_as_an_output_file(shell):
    assert shell("serve", "plant.toml", "--registers", "--csv", "/dev/null", port=None) == 2
    assert "/dev/null: cannot be written: it is not a file" in shell.err
