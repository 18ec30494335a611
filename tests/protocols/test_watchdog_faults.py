"""Faults by which virtual drives trip when their master falls silent: they are those that the watchdogs name."""

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
    """Start a drive of a model and stay silent for longer than its watchdog allows; return its status and its motor."""
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
def test_modbus_watchdog_trips_with_its_fault(model):
    assert model.watchdog.fault is not None
    # The order of the faults in the table must not matter.
    turned = replace(model, faults=MappingProxyType(dict(reversed(model.faults.items()))))
    status, _ = tripped(turned)
    assert status.fault
    assert (status.fault_code, status.fault_text) == (model.watchdog.fault, model.faults[model.watchdog.fault])


@pytest.mark.parametrize("model", MODBUS, ids=lambda model: model.name)
def test_modbus_watchdog_without_a_fault_code_trips_without_one(model):
    status, motor = tripped(replace(model, watchdog=replace(model.watchdog, fault=None)))
    assert motor.fault
    assert not status.running
    assert status.fault
    assert status.fault_code is None


@pytest.mark.parametrize(("name", "code"), [("g120", 1910), ("s110", 1910), ("v20", 72), ("micromaster4", 70)])
def test_uss_watchdog_trips_with_its_fault(name, code):
    model = load_model("drivecomm_uss", "uss", name)
    turned = replace(model, faults=MappingProxyType(dict(reversed(model.faults.items()))))
    status, motor = tripped(turned)
    assert status.fault
    assert motor.fault == code
