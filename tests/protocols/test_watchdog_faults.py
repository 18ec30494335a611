"""The fault that a virtual drive trips with when its master falls silent is the one that its watchdog names."""

from dataclasses import replace
from types import MappingProxyType

import pytest

import drivecomm
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive


def models_that_trip(protocol):
    """Return the models of a protocol whose watchdog can trip."""
    package = installed[protocol].package
    models = [load_model(package, protocol, name) for name in model_names(package, protocol)]
    return [model for model in models if model.watchdog is not None and "trip" in model.watchdog.actions]


def tripped(model):
    """Start a drive of a model, be silent for longer than its watchdog allows, and return its status then."""
    virtual = virtual_drive(model.protocol, 1, model=model)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(model.protocol, 1, model=model, confirmed=model.name)
        drivecomm.set_watchdog(drive, "trip", 5)
        able = drive.capabilities
        drive.set_reference(**({"percent": 40} if able.reference_percent else {"hz": 20}))
        drive.start()
        line.advance(4)
        virtual.follow(line.time)
        assert virtual.motor.running
        line.advance(20)
        virtual.follow(line.time)
        return drive.status(), virtual.motor


MODBUS = models_that_trip("modbus")


@pytest.mark.parametrize("model", MODBUS, ids=lambda model: model.name)
def test_modbus_drive_trips_with_the_fault_of_its_watchdog(model):
    assert model.watchdog.fault is not None
    # Wherever the fault stands in the table.
    turned = replace(model, faults=MappingProxyType(dict(reversed(model.faults.items()))))
    status, _ = tripped(turned)
    assert status.fault
    assert (status.fault_code, status.fault_text) == (model.watchdog.fault, model.faults[model.watchdog.fault])


@pytest.mark.parametrize("model", MODBUS, ids=lambda model: model.name)
def test_modbus_drive_shows_a_trip_without_a_number_where_its_watchdog_names_none(model):
    status, motor = tripped(replace(model, watchdog=replace(model.watchdog, fault=None)))
    assert motor.fault
    assert not status.running
    assert status.fault
    assert status.fault_code is None


@pytest.mark.parametrize(("name", "code"), [("g120", 1910), ("s110", 1910), ("v20", 72), ("micromaster4", 70)])
def test_uss_drive_trips_with_the_fault_of_its_watchdog(name, code):
    model = load_model("drivecomm_uss", "uss", name)
    turned = replace(model, faults=MappingProxyType(dict(reversed(model.faults.items()))))
    status, motor = tripped(turned)
    assert status.fault
    assert motor.fault == code
