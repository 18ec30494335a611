"""The page about serving a plant: its file is simulated, served, and read by commands and HTTP as the page shows."""

import json
import os
import socket
import time
import urllib.request

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

from drivecomm.server import read_settings

PAGE = ROOT / "docs" / "how-to" / "server.md"
PATIENCE_S = 10
BY_US = "a test of its own runs it beside the file"


@pytest.fixture
def plant_file(plant_file, monkeypatch):
    """Set the terminal width of the page; return the plant file."""
    monkeypatch.setenv("COLUMNS", "200")
    return plant_file


def test_plant_file_of_the_page_has_server_settings(plant_file):
    settings = read_settings(plant_file)
    assert settings.name == "hall 2"
    assert [kind for kind, _ in settings.doors] == ["http"]


@pytest.mark.soak
@pytest.mark.skipif(os.name != "posix", reason="simulators of the page end by SIGTERM")
def test_console_blocks_of_the_server_page_run(plant_file):
    places = ["127.0.0.1:4001", "127.0.0.1:4900", "127.0.0.1:8080"]
    with Elsewhere(places) as console:
        plant_file.write_text(console.own(plant_file.read_text()))
        ran = 0
        for block in blocks_of(PAGE):
            if block.language == "console" and BY_US in block.remark:
                console.play(block)
                ran += 1
    assert ran == 2


def answer_of(address):
    with urllib.request.urlopen(address, timeout=10) as answer:
        return answer.read().decode()


class Elsewhere(Console):
    """Console with free ports in place of those of the page, with server and simulator together, and with curl."""

    def __init__(self, places):
        super().__init__(in_process)
        sockets = [socket.create_server(("127.0.0.1", 0)) for _ in places]
        free = [f"127.0.0.1:{each.getsockname()[1]}" for each in sockets]
        self._places = dict(zip(places, free, strict=True))
        for each in sockets:
            each.close()

    def own(self, text):
        for shown, taken in self._places.items():
            text = text.replace(shown, taken)
        return text

    def _carry_out(self, command):
        words = self.own(command).partition("#")[0].split()
        if words[0] == "curl":
            code, output = 0, answer_of(words[-1])
            # A reader runs this command after the server has read its drives.
            end = time.monotonic() + PATIENCE_S
            while words[-1].endswith("/events") and '"kind":"fault"' not in output and time.monotonic() < end:
                time.sleep(0.05)
                output = answer_of(words[-1])
            assert json.loads(output)
        elif words[1] in ("simulate", "serve"):
            # The log goes to a file, since it would mix with the output on the screen.
            code, output = self.simulate([*words[1:], *(("--log", "server.log") if words[1] == "serve" else ())])
        else:
            code, output = in_process(words[1:])
        for shown, taken in self._places.items():
            output = output.replace(taken, shown)
        return code, output
