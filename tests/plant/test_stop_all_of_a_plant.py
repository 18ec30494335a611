"""Stopping all drives of an open plant: all lines concurrently, and each drive in the report."""

import pytest
from running_server import running_server
from serving_threads import served_in_thread

import drivecomm
from drivecomm.plant import OpenPlant, read_plant
from drivecomm.protocol import Stop
from drivecomm.virtual import PlantServer, VirtualPlant

PLANT = """
format = 1
[[line]]
name = "hall"
listen = "{hall}"
paced = false
[[line]]
name = "yard"
listen = "{yard}"
paced = false
[[drive]]
name = "pump"
line = "hall"
drive = "vabus:1"
options = {{ model = "agile" }}
armed = true
[[drive]]
name = "fan"
line = "yard"
drive = "danfoss-fc:3"
options = {{ model = "fc300" }}
"""


@pytest.fixture(autouse=True)
def _runtime_folder(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def plant(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT.format(hall="tcp:127.0.0.1:0", yard="tcp:127.0.0.1:0"), encoding="utf-8")
    with served_in_thread(PlantServer(VirtualPlant(read_plant(file)))) as server:
        places = {name: f"tcp:{address.partition('://')[2]}" for name, address in server.addresses.items()}
        file.write_text(PLANT.format(**places), encoding="utf-8")
        yield file


def summary(results):
    return sorted((each.line, each.drive or f"{each.protocol}:*", each.how, each.confirmed) for each in results)


ALL = [
    ("hall", "pump", Stop.RAMP, True),
    ("yard", "danfoss-fc:*", Stop.RAMP, False),
    ("yard", "fan", Stop.RAMP, True),
]


def test_plant_stops_all_drives_armed_or_not_over_its_own_ports(plant):
    heard = []
    with drivecomm.open_plant(plant) as opened:
        opened.drive("pump").start()
        results = opened.stop_all(on_result=heard.append)
        assert summary(results) == summary(heard) == ALL
        assert not opened.drive("pump").status().running


def test_plant_stops_all_drives_through_its_server(plant):
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        assert summary(opened.stop_all()) == ALL


def test_line_that_cannot_be_opened_is_reported_and_the_others_are_stopped(plant):
    opened = OpenPlant(read_plant(plant), port_of=lambda line: "/dev/none" if line.name == "hall" else line.reached_at)
    with opened:
        results = opened.stop_all()
    (pump,) = (each for each in results if each.drive == "pump")
    assert isinstance(pump.error, drivecomm.PortError)
    assert [each.confirmed for each in results if each.drive == "fan"] == [True]


def test_server_that_dies_is_reported_for_each_drive(plant):
    with drivecomm.open_plant(plant) as opened:
        with running_server(plant):
            buses = [opened.bus(name) for name in ("hall", "yard")]
        results = [each for bus in buses for each in bus.stop_all()]
    assert [each.drive for each in results] == ["pump", "fan"]
    assert all(isinstance(each.error, drivecomm.ServerLostError) for each in results)
