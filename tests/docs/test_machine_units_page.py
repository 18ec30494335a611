"""The page about machine units: its plant is served, and commanded as the page shows."""

import socket

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

from drivecomm.protocol import SPEED_QUANTITIES

PAGE = ROOT / "docs" / "how-to" / "machine-units.md"


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write the plant file of the page into an empty folder, with a free port."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT"):
        monkeypatch.delenv(name, raising=False)
    with socket.create_server(("127.0.0.1", 0)) as door:
        place = f"127.0.0.1:{door.getsockname()[1]}"
    (block,) = [block for block in blocks_of(PAGE) if block.title]
    (tmp_path / block.title).write_text(block.code.replace("127.0.0.1:4001", place))


@pytest.mark.usefixtures("file")
def test_console_blocks_of_the_machine_units_page_run():
    with Console(in_process) as console:
        for block in blocks_of(PAGE):
            if block.language == "console":
                console.play(block)


def test_machine_units_page_names_every_speed_quantity():
    text = PAGE.read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("`output_frequency`")]
    assert {name for name in SPEED_QUANTITIES if f"`{name}`" in line} == SPEED_QUANTITIES
