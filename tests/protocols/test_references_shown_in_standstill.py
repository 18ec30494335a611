"""References set before the start on drives that show them only while the motor runs."""

from types import SimpleNamespace

import pytest

import drivecomm
from drivecomm import StateError
from drivecomm.virtual import VirtualLine, virtual_drive

SHOWN = {"fuji": ("frenic", "M05"), "vabus": ("agile", 283)}


@pytest.fixture(params=SHOWN)
def shy(request):
    """Yield a drive that shows a final reference of 0 while its motor stands, with its line and measured values."""
    model, parameter = SHOWN[request.param]
    virtual = virtual_drive(request.param, 1, model=model)
    usual = virtual.store.measured[parameter]
    virtual.store.measured[parameter] = lambda: usual() * virtual.motor.running
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        yield SimpleNamespace(
            drive=bus.drive(request.param, 1, model=model), line=line, measured=virtual.store.measured, shown=parameter
        )


def test_reference_may_be_set_before_the_start(shy):
    shy.drive.set_reference(hz=20)
    shy.drive.start()
    shy.line.advance(60)
    assert shy.drive.read("output_frequency").value == 20
    shy.drive.set_reference(hz=30)


def test_other_final_reference_than_zero_in_standstill_is_an_error(shy):
    shy.measured[shy.shown] = lambda: 10 * (1 if shy.shown == "M05" else 100)
    with pytest.raises(StateError, match="10"):
        shy.drive.set_reference(hz=20)


def test_final_reference_of_zero_while_running_is_an_error(shy):
    shy.drive.set_reference(hz=20)
    shy.drive.start()
    shy.line.advance(60)
    shy.measured[shy.shown] = lambda: 0
    with pytest.raises(StateError):
        shy.drive.set_reference(hz=30)
