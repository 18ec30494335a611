"""A request whose reply is the request itself: an echo is not taken for it, whatever is known of the adapter."""

import pytest

import drivecomm
from drivecomm.errors import NoReplyError
from drivecomm.virtual import VirtualLine, virtual_drive

PRESENT, ABSENT = 3, 4


@pytest.mark.parametrize("paced", [True, False])
@pytest.mark.parametrize(
    ("echoes", "mode"), [(False, "off"), (True, "off"), (False, "auto"), (True, "auto"), (True, "expect")]
)
def test_only_the_drive_that_is_there_is_found(echoes, mode, paced):
    line = VirtualLine([virtual_drive("uss", PRESENT)], echo=echoes)
    port = line.port()
    port.paced = paced
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        for _ in range(2):
            with pytest.raises(NoReplyError):
                bus.drive("uss", ABSENT).probe()
            bus.drive("uss", PRESENT).probe()


@pytest.mark.parametrize("model", ["micromaster4", "g110", "v20", "g120", "s110", "masterdrives", "nord"])
def test_a_probe_reaches_every_series_and_no_motor(model):
    virtual = virtual_drive("uss", PRESENT, model=model)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("uss", PRESENT, model=model).probe()
    assert not virtual.motor.running
    assert not virtual.motor.fault


def test_a_running_g120_does_not_notice_that_another_program_probes_it():
    """A task without control word bit 10 would trip it with F07220."""
    virtual = virtual_drive("uss", PRESENT, model="g120")
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("uss", PRESENT, model="g120")
        drive.set_reference(percent=50)
        drive.start()
        line.advance(20)
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("uss", PRESENT, model="g120").probe()
        (found,) = bus.scan(["uss"], [PRESENT])
    assert found.sound
    virtual.motor.advance(line.time)
    assert virtual.motor.running
    assert not virtual.motor.fault
