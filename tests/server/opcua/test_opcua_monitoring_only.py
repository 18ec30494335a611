"""A served drive of a series that is monitoring only: each door shows the mark, and refuses commands."""

import json

import pytest
from asyncua import ua
from gauge_series import GAUGE
from served_core import ENGINEER, OPERATOR, asked, awaited, core_of
from served_opcua import PLANT, data, node, opened

from drivecomm.errors import NotSupported
from drivecomm.server.http.content import drive_text
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.sparkplug.metrics import metrics_of_drive

DRIVE = """
[[drive]]
name = "gauge"
drive = "modbus:7"
line = "yard"
armed = true
options = {{ model = "{model}" }}
link_loss = {{ policy = "hold" }}
network = {{ {door} = ["start", "reference", "reset"], write = ["0x2000"] }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.05 }}]
"""


@pytest.fixture
def plant_text(tmp_path):
    path = tmp_path / "gauge.toml"
    path.write_text(GAUGE, encoding="utf-8")
    return lambda door: PLANT + DRIVE.format(model=path, door=door)


@awaited
async def test_monitoring_only_drive_refuses_commands_with_that_reason(tmp_path, plant_text):
    async with core_of(tmp_path, plant_text("http")) as (core, _):
        plant = PlantForDoors(core, "hall")
        assert set(plant.may(OPERATOR, "gauge")) & {"start", "reset", "set_reference", "keep", "reverse"} == set()
        assert {"read", "status", "stop"} <= set(plant.may(OPERATOR, "gauge"))
        assert "start" not in plant.may(ENGINEER, "gauge")
        assert "start" in plant.may(ENGINEER, "pump")
        said = {name: json.loads(drive_text(plant, core.drive(name), [], OPERATOR)) for name in ("gauge", "pump")}
        assert (said["gauge"]["monitoring_only"], said["gauge"]["policies"]) == (True, [])
        assert said["pump"]["monitoring_only"] is False
        metrics = {each.name: each.value for each in metrics_of_drive(core.drive("gauge"), 0)}
        assert metrics["Properties/Monitoring Only"] is True
        for verb, arguments in (
            ("start", {}), ("keep", {"policy": "hold"}), ("reset", {}), ("stop", {}), ("set_reference", {"hz": 20}),
            ("write", {"parameter": "bus_control_word", "value": 1}),
        ):  # fmt: skip
            answer = await asked(core, ENGINEER, "gauge", verb, arguments=arguments)
            assert answer.outcome == "refused", verb
            assert isinstance(answer.error, NotSupported), verb
            assert "monitoring only" in str(answer.error), verb


@awaited
async def test_opc_ua_client_sees_a_monitoring_only_drive_without_commands(tmp_path, plant_text):
    async with opened(tmp_path, plant_text("opcua")) as one, one.client("otto") as otto:
        told = await data(otto, "drives/gauge/Identification/MonitoringOnly")
        assert (told.Value.VariantType, told.Value.Value) == (ua.VariantType.Boolean, True)
        assert (await data(otto, "drives/pump/Identification/MonitoringOnly")).Value.Value is False
        children = {(await each.read_browse_name()).Name for each in await node(otto, "drives/gauge").get_children()}
        assert "Stop" in children
        assert not children & {"Start", "SetReference", "Reset"}
