"""Fixtures: a runtime folder and a virtual plant for each test."""

import pytest
from serving_threads import served_in_thread

from drivecomm.plant import read_plant
from drivecomm.virtual import PlantServer, VirtualPlant

PLANT = """
format = 1

[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false

[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
armed = true
reply_delay_s = 0.0

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = {{ model = "fc300" }}
reply_delay_s = 0.0
"""


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path, monkeypatch):
    """Give servers and clients of the test a runtime folder of their own; return its subfolder drivecomm."""
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    return tmp_path / "run" / "drivecomm"


@pytest.fixture
def plant(tmp_path):
    """Serve a plant of virtual drives; yield its plant file."""
    file = tmp_path / "plant.toml"
    file.write_text(PLANT.format(folder=tmp_path), encoding="utf-8")
    with served_in_thread(PlantServer(VirtualPlant(read_plant(file)))):
        yield file
