"""Direction of rotation on series that show it by the sign of a measured value and not by a status bit."""

from dataclasses import replace

import pytest

import drivecomm
from drivecomm.errors import UsageError
from drivecomm.models import load_model
from drivecomm.profiles import control_entries
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_modbus.options import ModbusOptions
from drivecomm_modbus.parameters import place_of

BY_SIGN = ["siemens-g120", "siemens-v20", "danfoss-fc", "bonfiglioli", "abb-acs355", "abb-acs550"]


@pytest.fixture
def drive_of():
    """Yield a function that returns a virtual drive, its line and the drive object of its master."""
    buses = []

    def make(protocol, model):
        virtual = virtual_drive(protocol, 1, model=model)
        line = VirtualLine([virtual])
        buses.append(drivecomm.open_bus(line.port))
        return virtual, line, buses[-1].drive(protocol, 1, model=model, confirmed=model)

    yield make
    for bus in buses:
        bus.close()


def told(virtual, line, drive, *, backwards):
    """Run a motor in a direction; return the direction in its status while it runs and when it stands."""
    turns = drive.capabilities.reverse
    drive.set_reference(percent=-40 if backwards and not turns else 40)
    drive.start(reverse=backwards and turns)
    line.advance(60)
    seen = [drive.status().reverse]
    assert virtual.motor.output_hz == pytest.approx(-20 if backwards else 20, abs=0.1)
    drive.stop()
    line.advance(60)
    return (*seen, drive.status().reverse)


@pytest.mark.parametrize("model", BY_SIGN)
@pytest.mark.parametrize("backwards", [False, True])
def test_status_shows_the_direction_while_the_motor_turns(drive_of, model, backwards):
    assert told(*drive_of("modbus", model), backwards=backwards) == (backwards, None)


@pytest.mark.parametrize(
    ("model", "other"),
    [("siemens-g120", ("uss", "g120")), ("siemens-v20", ("uss", "v20")), ("danfoss-fc", ("danfoss-fc", "fc302"))],
)
@pytest.mark.parametrize("backwards", [False, True])
def test_direction_is_the_same_over_the_other_protocol_of_the_drive(drive_of, model, other, backwards):
    over_modbus = told(*drive_of("modbus", model), backwards=backwards)
    assert over_modbus == told(*drive_of(*other), backwards=backwards)


@pytest.mark.parametrize("model", BY_SIGN)
def test_direction_is_not_read_while_the_motor_stands(drive_of, model):
    _, line, drive = drive_of("modbus", model)
    drive.status()
    sent = []
    line.monitors.append(lambda each: sent.append(each.data) if each.sender is None else None)
    assert drive.status().reverse is None
    assert len(sent) == 1


def test_direction_is_unknown_if_the_drive_refuses_its_register():
    model = load_model("drivecomm_modbus", "modbus", "siemens-g120")
    fewer = {address: info for address, info in model.parameters.items() if address not in ("40342", "40341")}
    poor = replace(
        model,
        parameters=fewer,
        quantities={name: each for name, each in model.quantities.items() if each in fewer},
        control={key: value for key, value in model.control.items() if key not in ("direction", "signed")},
    )
    line = VirtualLine([virtual_drive("modbus", 1, model=poor)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model=model, confirmed="siemens-g120")
        drive.set_reference(percent=40)
        drive.start()
        status = drive.status()
        assert status.running
        assert status.reverse is None


def test_direction_by_a_parameter_without_a_sign_is_refused():
    model = load_model("drivecomm_modbus", "modbus", "siemens-g120")
    wrong = replace(model, control={**model.control, "direction": "40343"})
    with pytest.raises(UsageError, match="direction: parameter 40343 is u16, without a sign"):
        control_entries(wrong, lambda address: place_of(address, ModbusOptions(register_base=40001)))
