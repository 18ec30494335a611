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


def grouped(plant, **groups):
    """Put drives of a plant file into groups."""
    text = plant.read_text(encoding="utf-8")
    for name, names in groups.items():
        text = text.replace(f'name = "{name}"', f'name = "{name}"\ngroups = {names}')
    plant.write_text(text, encoding="utf-8")


GROUP = [("hall", "pump", Stop.COAST, True), ("yard", "fan", Stop.COAST, True)]


def test_plant_stops_the_drives_of_a_group_on_all_lines_without_a_broadcast(plant):
    grouped(plant, pump=["wet", "hall 2"], fan=["wet"])
    heard = []
    with drivecomm.open_plant(plant) as opened:
        opened.drive("pump").start()
        assert summary(opened.stop_group("wet", "coast", on_result=heard.append)) == summary(heard) == GROUP
        assert not opened.drive("pump").status().running
        assert summary(opened.stop_group("hall 2", "coast")) == GROUP[:1]
        with pytest.raises(drivecomm.UsageError, match="there is no group 'fan' in this plant"):
            opened.stop_group("fan")


def test_plant_stops_a_group_through_its_server(plant):
    grouped(plant, pump=["wet"], fan=["wet"])
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        assert summary(opened.stop_group("wet", "coast")) == GROUP


def test_unopened_line_of_a_group_is_reported_and_other_lines_are_stopped(plant):
    grouped(plant, pump=["wet"], fan=["wet"])
    opened = OpenPlant(read_plant(plant), port_of=lambda line: "/dev/none" if line.name == "hall" else line.reached_at)
    with opened:
        assert [(each.drive, each.confirmed) for each in opened.stop_group("wet")] == [("pump", False), ("fan", True)]


def test_unopened_line_is_reported_and_other_lines_are_stopped(plant):
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
