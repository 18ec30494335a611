"""Findings of doctor about panels behind a serial server, which may use line settings of its own."""

import pytest

from drivecomm.commissioning.doctor.panel import PanelReading
from drivecomm.commissioning.doctor.panel_findings import panel_findings
from drivecomm.models import SheetRow
from drivecomm.protocol import DriveConfig, PanelSetting


@pytest.mark.parametrize(
    ("options", "carries", "weight"),
    [({}, True, "problem"), ({}, False, "note"), ({"baudrate": 19200}, False, "problem")],
    ids=["a port of its own", "a serial server", "a serial server, and the plant says the rate"],
)
def test_baud_rate_behind_a_serial_server_is_a_problem_if_the_plant_states_it(options, carries, weight):
    setting = PanelSetting(parameter="P1", name="rate", purpose="line", made_from="baudrate", source="a page")
    row = SheetRow(setting=setting, value="19200", made_of="19200 baud")
    drive = DriveConfig(protocol="uss", address=3, options=options)
    (found,) = panel_findings(
        [PanelReading(drive=drive, row=row, shown="9600", agrees=False)], carries_settings=carries
    )
    assert found[0] == weight
