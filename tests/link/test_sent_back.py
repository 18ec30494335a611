"""A request whose reply equals it: an echo is not accepted as the reply, with any kind of adapter."""

import pytest

import drivecomm
from drivecomm.errors import NoReplyError
from drivecomm.virtual import VirtualLine, virtual_drive

PRESENT, ABSENT = 3, 4


@pytest.mark.parametrize("paced", [True, False])
@pytest.mark.parametrize(
    ("echoes", "mode"), [(False, "off"), (True, "off"), (False, "auto"), (True, "auto"), (True, "expect")]
)
def test_probe_with_a_mirrored_reply_finds_only_the_present_drive(echoes, mode, paced):
    line = VirtualLine([virtual_drive("uss", PRESENT)], echo=echoes)
    port = line.port()
    port.paced = paced
    with drivecomm.open_bus(lambda: port, echo=mode) as bus:
        for _ in range(2):
            with pytest.raises(NoReplyError):
                bus.drive("uss", ABSENT).probe()
            bus.drive("uss", PRESENT).probe()


@pytest.mark.parametrize("model", ["micromaster4", "g110", "v20", "g120", "s110", "masterdrives", "nord"])
def test_probe_reaches_every_series_and_moves_no_motor(model):
    virtual = virtual_drive("uss", PRESENT, model=model)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("uss", PRESENT, model=model).probe()
    assert not virtual.motor.running
    assert not virtual.motor.fault


def test_probe_by_another_program_does_not_disturb_a_running_g120():
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
