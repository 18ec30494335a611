"""Plausibility of readings by common name: impossible values are marked uncertain, with the reason."""

from decimal import Decimal

import pytest
from addresses import address_of

import drivecomm
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.models import Plausibility, load_model, model_names, quantities
from drivecomm.models.plausible import limits
from drivecomm.protocol import installed, new_reading
from drivecomm.virtual import VirtualLine, virtual_drive

EVERY = [(name, model) for name in sorted(installed) for model in model_names(installed[name].package, name)]
HZ_OPTIONS = {"danfoss-fc": {"reference_maximum_hz": 50}, "uss": {"reference_frequency_hz": 50}}


def judged(name, value, plate=()):
    judge = Plausibility()
    for each, rated in dict(plate).items():
        judge.judged(reading(each, rated))
    return judge.judged(reading(name, value)).doubt


def reading(name, value):
    return new_reading(parameter="1", value=value, raw=1, unit=quantities()[name].unit, name=name)


def test_limits_refer_to_common_names_only():
    assert limits().keys() <= quantities().keys()
    assert {each.of for each in limits().values()} - {""} <= quantities().keys()


@pytest.mark.parametrize(
    ("name", "value", "plate", "says"),
    [
        ("output_voltage", 400, {}, ""),
        ("output_voltage", Decimal("4000.0"), {}, "not plausible: above 1000 V, what drives have"),
        ("output_voltage", Decimal(4000), {"motor_rated_voltage": 400}, "above 1000.0 V, 2.5 times its motor_rated_v"),
        ("output_voltage", Decimal(3000), {"motor_rated_voltage": 3300}, ""),
        ("output_voltage", Decimal(4000), {"motor_rated_voltage": 0}, "above 1000 V"),
        ("dc_link_voltage", 5600, {}, "above 1500 V"),
        ("drive_thermal_load", 1000, {}, "above 600 %"),
        ("torque_percent", -1000, {}, "below -600 %"),
        ("output_current", Decimal("100.0"), {"motor_rated_current": Decimal("5.2")}, "above 78.0 A, 15 times"),
        ("running_hours", 80871429, {}, "above 876600 h"),
        ("running_hours", 80000, {}, ""),
        ("operating_hours", -1, {}, "below 0 h"),
        ("heat_sink_temperature", Decimal("6553.5"), {}, "above 250 degC"),
        ("fault_code", 65535, {}, ""),
        ("drive_type", "FC-302", {}, ""),
    ],
)
def test_reading_outside_its_limits_is_doubted(name, value, plate, says):
    doubt = judged(name, value, plate)
    assert says in doubt
    assert bool(doubt) is bool(says)


def test_implausible_reading_is_uncertain_by_read_polled_and_read_many():
    drive = virtual_drive("modbus", 1, model="delta")
    with drivecomm.open_bus(VirtualLine([drive]).port) as bus:
        one = bus.drive("modbus", 1, model="delta")
        drive._machine.live = lambda _: None
        drive.poke("0x2106", 40000)
        for found in (one.read("output_voltage"), one.polled("output_voltage"), one.read_many(["output_voltage"])[0]):
            assert str(found) == "4000.0 V"
            assert found.quality == "uncertain"
            assert "above 1000 V" in found.doubt
        assert one.read("0x2106").quality == "good", "only common names have limits"


@pytest.mark.parametrize(("protocol", "model"), EVERY)
def test_virtual_drive_at_its_rated_load_is_plausible(protocol, model):
    known = load_model(installed[protocol].package, protocol, model)
    line = VirtualLine([virtual_drive(protocol, address_of(protocol), model=known)])
    line.drives[0].motor.load = 1.0
    with drivecomm.open_bus(line.port) as bus:
        one = bus.drive(protocol, address_of(protocol), model=model, confirmed=model, **HZ_OPTIONS.get(protocol, {}))
        try:
            one.set_reference(**({"hz": 50} if one.capabilities.reference_hz else {"percent": 100}))
            one.start()
        except NotSupported:
            pass
        line.advance(60)
        names = sorted(known.quantities, key=lambda name: not name.startswith("motor_rated"))
        for name in names:
            try:
                found = one.read(name)
            except DriveCommError:
                continue
            assert "not plausible" not in found.doubt, f"{name}: {found}, {found.doubt}"
