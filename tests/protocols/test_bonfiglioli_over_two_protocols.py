"""One Bonfiglioli drive shows the same over VABus and over Modbus."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

FREQUENCIES = ("210", "241", "282", "283", "480")
MODELS = {"vabus": "agile", "modbus": "bonfiglioli"}


@pytest.fixture(params=MODELS)
def turning_backwards(request):
    """A virtual drive that turns at -20 Hz."""
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
