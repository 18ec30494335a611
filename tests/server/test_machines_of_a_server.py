"""Machine units in a server: doors accept references in them, and show values in them."""

import json
from dataclasses import replace
from functools import partial

import pytest
from served_core import OPERATOR, PLANT, asked, awaited, core_of, until

from drivecomm.protocol import MachineUnit
from drivecomm.server.for_doors import PlantForDoors
from drivecomm.server.http.content import drive_text

BELT = PLANT.replace('drive = "vabus:1"', 'drive = "vabus:1"\nmachine = { unit = "m/min", per_hz = "1.25" }').replace(
    'parameters = ["output_frequency"]', 'parameters = ["output_frequency", "480", "reference_frequency"]', 1
)


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path, BELT)


def value_of(served, name):
    value = served.table.value("pump", name)
    return None if value is None or value.reading is None else str(value.reading.value)


@pytest.mark.parametrize("given", [12.5, "12.5", "12.5 m/min"])
@awaited
async def test_server_accepts_a_reference_in_the_machine_unit(core, given):
    async with core() as (served, _):
        answer = await asked(served, OPERATOR, "pump", "set_reference", arguments={"machine": given})
        assert (answer.outcome, answer.error) == ("done", None)
        await until(lambda: value_of(served, "480") == "10.00")


@pytest.mark.parametrize(
    ("drive", "arguments", "sentence"),
    [
        ("pump", {"machine": "12.5 m/s"}, "not a reference in m/min, the unit of this machine"),
        ("pump", {"machine": "70 m/min"}, "above 50.00 Hz"),
        ("pump", {"machine": 10, "hz": 10}, "one of percent, hz, rpm and machine"),
        ("pump", {"machine": "-10 m/min"}, "add 'reverse' to network"),
        ("pump", {"machine": [1, [1, 0], 0]}, "is not a number"),
        ("pump", {"hz": [1, [1, 0], 0]}, "is not a number"),
        ("fan", {"machine": 10}, "write machine = { unit"),
    ],
)
@awaited
async def test_server_refuses_an_invalid_machine_reference(tmp_path, drive, arguments, sentence):
    text = BELT.replace('policy = "coast", watchdog_s = 2 }', 'policy = "hold" }\nnetwork = { http = ["reference"] }')
    async with core_of(tmp_path, text) as (served, _):
        await until(lambda: value_of(served, "480") is not None)
        before = value_of(served, "480")
        answer = await asked(served, OPERATOR, drive, "set_reference", arguments=arguments)
        assert answer.outcome in ("refused", "failed")
        assert sentence in str(answer.error)
        assert value_of(served, "480") == before


@awaited
async def test_server_shows_frequencies_in_the_machine_unit(core):
    async with core() as (served, _):
        await asked(served, OPERATOR, "pump", "set_reference", arguments={"machine": 12.5})
        await until(lambda: value_of(served, "reference_frequency") == "10.00")
        values = [each for each in served.table.values() if each.drive == "pump"]
        said = json.loads(drive_text(PlantForDoors(served, "hall"), served.drive("pump"), values, OPERATOR))
        assert said["machine_unit"] == "m/min"
        beside = {each["name"]: each.get("machine_value") for each in said["values"]}
        assert beside == {"status": None, "480": None, "output_frequency": 0.0, "reference_frequency": 12.5}
        fan = json.loads(drive_text(PlantForDoors(served, "hall"), served.drive("fan"), [], OPERATOR))
        assert (fan["machine_unit"], fan["actual_machine"]) == ("", None)


@awaited
async def test_reload_applies_a_changed_machine_unit(core):
    async with core() as (served, _):
        await until(lambda: value_of(served, "480") is not None)
        twice = MachineUnit(unit="m/min", per_hz="2.5")
        drives = tuple(replace(each, machine=twice) if each.name == "pump" else each for each in served.plant.drives)
        await served.changed(replace(served.plant, drives=drives))
        answer = await asked(served, OPERATOR, "pump", "set_reference", arguments={"machine": "12.5 m/min"})
        assert (answer.outcome, answer.error) == ("done", None)
        await until(lambda: value_of(served, "480") == "5.00")
        await until(lambda: value_of(served, "reference_frequency") == "5.00")
        assert str(served.table.value("pump", "reference_frequency").at_machine) == "12.50 m/min"
