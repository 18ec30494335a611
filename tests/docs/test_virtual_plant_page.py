"""The page about the virtual plant: its file is served, read and controlled as the page shows."""

import socket

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

from drivecomm.plant import read_plant
from drivecomm.virtual import VirtualPlant

PAGE = ROOT / "docs" / "how-to" / "virtual-plant.md"


@pytest.fixture
def plant_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_CONTROL"):
        # The variable is set first, so that pytest undoes an export by the page afterwards.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    (content,) = (block.code for block in blocks_of(PAGE) if block.title == "plant.toml")
    path = tmp_path / "plant.toml"
    path.write_text(content)
    return path


def test_plant_file_of_the_page_has_two_virtual_drives(plant_file):
    assert len(VirtualPlant(read_plant(plant_file)).states()) == 2


def test_console_blocks_of_the_virtual_plant_page_run(plant_file):
    with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as two:
        line, control = (f"127.0.0.1:{door.getsockname()[1]}" for door in (one, two))
    plant_file.write_text(plant_file.read_text().replace("127.0.0.1:4001", line))
    with FreePorts(in_process, line, control) as console:
        for block in blocks_of(PAGE):
            if block.language == "console":
                console.play(block)


class FreePorts(Console):
    """Console that replaces the ports of the page by free ones."""

    def __init__(self, run, line, control):
        super().__init__(run)
        self._own = line
        self._control = control

    def _carry_out(self, command):
        code, output = super()._carry_out(command.replace("127.0.0.1:4900", self._control))
        return code, output.replace(self._control, "127.0.0.1:4900")
