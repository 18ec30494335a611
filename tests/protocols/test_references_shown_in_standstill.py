"""A reference is set before the start on a drive that shows it only while its motor runs."""

from types import SimpleNamespace

import pytest

import drivecomm
from drivecomm import StateError
from drivecomm.virtual import VirtualLine, virtual_drive

SHOWN = {"fuji": ("frenic", "M05"), "vabus": ("agile", 283)}


@pytest.fixture(params=SHOWN)
def shy(request):
    """A drive that shows a final reference of 0 while its motor stands, with its line and its virtual side."""
    model, parameter = SHOWN[request.param]
    virtual = virtual_drive(request.param, 1, model=model)
    usual = virtual.store.measured[parameter]
    virtual.store.measured[parameter] = lambda: usual() * virtual.motor.running
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        yield SimpleNamespace(
            drive=bus.drive(request.param, 1, model=model), line=line, measured=virtual.store.measured, shown=parameter
        )


def test_usual_order_of_reference_and_start_works(shy):
    shy.drive.set_reference(hz=20)
    shy.drive.start()
    shy.line.advance(60)
    assert shy.drive.read("output_frequency").value == 20
    shy.drive.set_reference(hz=30)


def test_other_reference_than_zero_is_refused_in_standstill(shy):
    shy.measured[shy.shown] = lambda: 10 * (1 if shy.shown == "M05" else 100)
    with pytest.raises(StateError, match="10"):
        shy.drive.set_reference(hz=20)


def test_zero_of_a_running_motor_is_refused(shy):
    shy.drive.set_reference(hz=20)
    shy.drive.start()
    shy.line.advance(60)
    shy.measured[shy.shown] = lambda: 0
    with pytest.raises(StateError):
        shy.drive.set_reference(hz=30)
