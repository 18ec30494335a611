"""Shell completion of partly typed command lines, which a shell requests through click's environment variables."""

import os
import subprocess
import sys

import pytest

from drivecomm.cli import main
from drivecomm.cli.entry import COMPLETION

PLANT = """
format = 1
[[line]]
name = "hall"
port = "nowhere"
[[drive]]
name = "pump"
groups = ["farm"]
drive = "vabus:1"
[[drive]]
name = "fan"
drive = "vabus:2"
"""


@pytest.fixture
def offered(capfd, monkeypatch, tmp_path):
    """Return a function that gives the completions of a command line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.setenv(COMPLETION, "bash_complete")
    (tmp_path / "plant.toml").write_text(PLANT, encoding="utf-8")

    def ask(text):
        monkeypatch.setenv("COMP_WORDS", text)
        monkeypatch.setenv("COMP_CWORD", str(text.count(" ")))
        assert main([]) == 0
        return [each.partition(",")[2] or each for each in capfd.readouterr().out.split()]

    return ask


@pytest.mark.parametrize(
    ("words", "offers"),
    [
        ("drivecomm rea", ["read"]),
        ("drivecomm models s", ["show", "setup"]),
        ("drivecomm read --ba", ["--baudrate"]),
        ("drivecomm read p", ["pump"]),
        ("drivecomm stop f", ["fan", "farm"]),
        ("drivecomm stop pump f", ["fan", "farm"]),
        ("drivecomm start f", ["fan"]),
        ("drivecomm scan --protocol vl", ["vlt3500"]),
        ("drivecomm read pump 481 --echo ", ["off", "expect", "auto"]),
        ("drivecomm read pump --arm", []),
    ],
)
def test_partly_typed_word_is_completed(offered, words, offers):
    assert [word for word in offered(words) if word] == offers


def test_files_are_completed_by_the_shell(offered):
    assert offered("drivecomm backup pump set") == ["set"]


def test_drives_of_a_plant_that_cannot_be_read_are_not_offered(offered, tmp_path):
    (tmp_path / "plant.toml").write_text("no plant", encoding="utf-8")
    assert offered("drivecomm read p") == []


def test_completing_the_name_of_a_command_loads_no_command():
    program = (
        "import sys; from drivecomm.cli import main; main([]);"
        "commands = ('drivecomm.cli.stats', 'drivecomm.cli.status', 'drivecomm.cli.start', 'drivecomm.bus');"
        "print(*(m for m in sys.modules if m.startswith(commands)))"
    )
    asked = {COMPLETION: "bash_complete", "COMP_WORDS": "drivecomm st", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env={**os.environ, **asked},
    )
    assert done.stdout.split() == ["plain,stats", "plain,status", "plain,start", "plain,stop"]


def test_call_with_arguments_runs_although_the_completion_variable_is_set(shell, monkeypatch):
    monkeypatch.setenv(COMPLETION, "bash_complete")
    shell.line()
    assert shell("stop", "vabus:1", "--trace") == 0
    assert "stop (ramp) commanded" in shell.out
