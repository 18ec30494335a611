"""The page about judging a master, with its commands and recipes carried out."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "judge-a-master.md"
BY_US = "tests/docs/test_judge_page.py runs it"

pytestmark = [
    pytest.mark.soak,
    pytest.mark.timeout(300),
    pytest.mark.skipif(os.name != "posix", reason="the page uses a pseudo-terminal"),
]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    # The page calls the interpreter `python`.
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")


def write_files():
    for block in blocks_of(PAGE):
        if block.title:
            Path(block.title).write_text(block.code, encoding="utf-8")


def test_commands_of_the_judge_page_run():
    ran = 0
    with Console(in_process) as console:
        for block in blocks_of(PAGE):
            if block.title:
                Path(block.title).write_text(block.code, encoding="utf-8")
            elif BY_US in block.remark:
                console.play(block)
                ran += 1
    assert ran == 4
    assert "<testsuite " in Path("junit.xml").read_text(encoding="utf-8")
    assert "<h2>" in Path("report.html").read_text(encoding="utf-8")


def commands_of_recipes():
    for block in blocks_of(PAGE):
        if block.language == "yaml":
            for command in re.findall(r"(?:run:|-) (drivecomm .+)", block.code):
                yield pytest.param(shlex.split(command), id=f"yaml-{block.line}")
        elif block.language == "robot":
            row = next(line for line in block.code.splitlines() if "Run Process" in line)
            words = re.split(r"\s{2,}|\t", row.partition("Run Process")[2].strip())
            yield pytest.param([word for word in words if "=" not in word], id=f"robot-{block.line}")


@pytest.mark.parametrize("words", [*commands_of_recipes()])
def test_recipe_judges_the_master_of_the_page(words):
    write_files()
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    assert Path("report.html").exists()


def test_cases_of_the_page_run_as_pytest_tests():
    write_files()
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "test_my_driver.py",
        "-k",
        "plain or lost",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout
    assert "3 passed" in done.stdout
