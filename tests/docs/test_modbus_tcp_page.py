"""The Modbus TCP page: its plant file is simulated, served and read by mbpoll as the page shows."""

import os
import shutil
import socket
import subprocess
from importlib.metadata import entry_points

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

from drivecomm.server import read_settings
from drivecomm.server.modbus_tcp import ModbusTcpDoor

PAGE = ROOT / "docs" / "how-to" / "modbus-tcp.md"
BY_US = "a test of its own runs it beside the file"
HALL, DOOR = "4001", "5020"


def test_plant_file_of_the_page_has_a_valid_door(plant_file):
    [(kind, table)] = read_settings(plant_file).doors
    assert kind == "modbus-tcp"
    assert ModbusTcpDoor(table).settings.units == {1: "pump", 2: "fan"}


@pytest.mark.usefixtures("plant_file")
def test_register_map_on_the_page_is_correct():
    with Console(in_process) as console:
        blocks = [block for block in blocks_of(PAGE) if "--registers" in block.code and block.language == "console"]
        assert len(blocks) == 1
        console.play(blocks[0])


@pytest.mark.soak
@pytest.mark.foreign
@pytest.mark.skipif(os.name != "posix", reason="simulators of the page end by SIGTERM")
@pytest.mark.skipif(not shutil.which("mbpoll"), reason="mbpoll is not installed; the page reads registers with it")
@pytest.mark.skipif(
    not any(each.name == "modbus-tcp" for each in entry_points(group="drivecomm.doors")),
    reason="the installed drivecomm is older than its Modbus TCP door; install it again",
)
def test_mbpoll_commands_of_the_page_run(plant_file):
    with Elsewhere() as console:
        plant_file.write_text(console.own(plant_file.read_text()))
        console.simulate(["simulate", "plant.toml"])
        console.simulate(["serve", "plant.toml", "--log", "server.log"])
        blocks = [block for block in blocks_of(PAGE) if BY_US in block.remark and "mbpoll" in block.code]
        assert len(blocks) == 1
        console.answers()
        console.play(blocks[0])


class Elsewhere(Console):
    """Console that replaces the ports of the page by free ones, and can run mbpoll."""

    def __init__(self):
        super().__init__(in_process)
        sockets = [socket.create_server(("127.0.0.1", 0)) for _ in (HALL, DOOR)]
        self._ports = {shown: str(each.getsockname()[1]) for shown, each in zip((HALL, DOOR), sockets, strict=True)}
        for each in sockets:
            each.close()

    def own(self, text):
        for shown, taken in self._ports.items():
            text = text.replace(shown, taken)
        return text

    def answers(self):
        """Wait until the frequency of the pump can be read."""
        for _ in range(40):
            if "failed" not in self._carry_out(f"mbpoll -0 -a 1 -r 8 -t 3:float -B -p {DOOR} -1 127.0.0.1")[1]:
                return
        pytest.fail("the pump does not answer")

    def _carry_out(self, command):
        words = self.own(command).partition("#")[0].split()
        if words[0] != "mbpoll":
            return super()._carry_out(command)
        done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
        return done.returncode, done.stdout + done.stderr
