"""The timing of a slow line holds also if a network delivers a reply in one piece."""

from dataclasses import replace

import pytest

from drivecomm.bus import open_bus
from drivecomm.virtual import virtual_drive

READ = {
    "danfoss-fc": ("fc302", "16-13"),
    "fuji": ("frenic", "M09"),
    "uss": ("micromaster4", "1082"),
    "vabus": ("agile", "481"),
}


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["tcp", "rfc2217"])
@pytest.mark.parametrize("protocol", READ)
def test_drive_at_1200_baud_answers_within_the_usual_reply_timeout(protocol, kind, serving):
    model, parameter = READ[protocol]
    virtual = virtual_drive(protocol, 1, model=model)
    virtual.settings = replace(virtual.settings, baudrate=1200)
    with serving([virtual], kind, paced=True) as server, open_bus(server.address) as bus:
        drive = bus.drive(protocol, 1, model=model, baudrate=1200, attempts=1)
        for _ in range(2):
            drive.read(parameter)
        assert bus.counters[drive.name]["timeouts"] == 0
