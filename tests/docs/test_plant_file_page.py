"""The page about the plant file: its files are served, read and commanded as the page shows."""

import contextlib
import io
import socket

import pytest
from console import Console, in_process, must_match
from pages import ROOT, blocks_of

from drivecomm.plant import read_plant
from drivecomm.protocol import NETWORK_VERBS

PAGE = ROOT / "docs" / "reference" / "plant-file.md"


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Write the files of the page into an empty folder; return the folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT"):
        monkeypatch.delenv(name, raising=False)
    with socket.create_server(("127.0.0.1", 0)) as door:
        place = f"127.0.0.1:{door.getsockname()[1]}"
    for block in blocks_of(PAGE):
        if block.title:
            (tmp_path / block.title).write_text(block.code.replace("127.0.0.1:4001", place))
    return tmp_path


def test_example_plant_file_is_valid(files):
    pump, fan = read_plant(files / "plant.toml").drives
    assert (pump.armed, fan.armed) == (True, False)
    assert pump.poll[0].parameters == ("output_frequency", "480")
    assert pump.link_loss.policy == "trip"


def test_page_lists_every_network_verb():
    text = PAGE.read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("`network` lists")]
    assert line.partition(": ")[2] == ", ".join(f"`{verb}`" for verb in NETWORK_VERBS) + "."


@pytest.mark.soak
@pytest.mark.usefixtures("files")
def test_blocks_of_the_plant_file_page_run():
    with Console(in_process) as console:
        printed = ""
        for block in blocks_of(PAGE):
            if block.language == "console":
                console.play(block)
            elif block.language == "python":
                with contextlib.redirect_stdout(io.StringIO()) as output:
                    exec(compile("\n" * block.line + block.code, str(PAGE), "exec"), {"__name__": "__main__"})
                printed = output.getvalue()
            elif block.remark == "prints":
                must_match(block.code, printed, block)
