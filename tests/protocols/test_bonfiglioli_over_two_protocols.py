"""A Bonfiglioli drive, which shows the same values over VABus and over Modbus."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

FREQUENCIES = ("210", "241", "282", "283", "480")
MODELS = {"vabus": "agile", "modbus": "bonfiglioli"}


@pytest.fixture(params=MODELS)
def turning_backwards(request):
    """Yield a virtual drive that turns at -20 Hz."""
    line = VirtualLine([virtual_drive(request.param, 1, model=MODELS[request.param])])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(request.param, 1, model=MODELS[request.param])
        if request.param == "modbus":
            drive.set_reference(hz=-20)
            drive.start()
        else:
            drive.set_reference(hz=20)
            drive.start(reverse=True)
        line.advance(30)
        yield drive


@pytest.mark.parametrize("parameter", FREQUENCIES)
def test_frequency_has_the_sign_of_the_direction(turning_backwards, parameter):
    # long, two's complement: Agile VABus manual VEC 686 p. 35 and 41 (-120.00 Hz in parameter 480)
    assert turning_backwards.read(parameter).value == Decimal(-20)


@pytest.mark.parametrize("protocol", MODELS)
@pytest.mark.parametrize(("parameter", "unit"), [("289", "degC"), ("291", "degC"), ("294", "A"), ("297", "kW")])
def test_peak_and_average_values_have_a_factor_of_0_1(protocol, parameter, unit):
    # Ferretto.VW.MAS.InverterDriver divides them by 10.
    info = load_model(installed[protocol].package, protocol, MODELS[protocol]).parameters[parameter]
    assert (453 * info.factor, info.unit) == (Decimal("45.3"), unit)


@pytest.mark.parametrize("protocol", MODELS)
@pytest.mark.parametrize(
    ("code", "text"),
    [
        # A program of a warehouse builder compares 260 with 1454H: Ferretto.VW.MAS.InverterDriver
        (0x1454, "external error (F1454)"),
        (0x0503, "short circuit or earth fault (F0503)"),
        (0x0C13, "1 ms task overrun (F0C13)"),
        # VEC 383 p. 35
        (0x2010, "watchdog: no correct exchange for the time in parameter 413 (F2010)"),
    ],
)
def test_fault_code_has_the_text_of_its_hexadecimal_digits(protocol, code, text):
    virtual = virtual_drive(protocol, 1, model=MODELS[protocol])
    virtual.trip(code, 0.0)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive(protocol, 1, model=MODELS[protocol])
        status = drive.status()
        assert (drive.read("fault_code").value, status.fault_code, status.fault_text) == (code, code, text)


@pytest.mark.parametrize("protocol", MODELS)
def test_link_loss_trips_with_the_watchdog_fault(protocol):
    line = VirtualLine([virtual_drive(protocol, 1, model=MODELS[protocol])])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1, model=MODELS[protocol])
        drive.write("413", 1)
        drive.set_reference(hz=20)
        drive.start()
        line.advance(10)
        assert drive.read("fault_code").value == 0x2010
