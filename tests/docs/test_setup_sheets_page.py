"""The page about set-up sheets: its sheet is printed, and its doctor finds the wrong panel setting."""

import os

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "set-up-sheets.md"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")


@pytest.mark.usefixtures("plant_file")
def test_console_blocks_of_the_setup_sheets_page_run(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    with Console(in_process) as console:
        for block in blocks_of(PAGE):
            if block.language == "console":
                console.play(block)
