"""References in per cent and in hertz, to Modbus drives that accept only one of the two."""

from dataclasses import replace
from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.models import is_monitoring_only, load_model, model_names
from drivecomm.profiles import full_scale_of
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def drive_of():
    """Yield a function that returns a virtual drive of a model and the drive object of its master."""
    buses = []

    def make(model, **options):
        virtual = virtual_drive("modbus", 1, model=model)
        make.line = VirtualLine([virtual])
        buses.append(drivecomm.open_bus(make.line.port))
        return virtual, buses[-1].drive("modbus", 1, model=model, confirmed=model, **options)

    yield make
    for bus in buses:
        bus.close()


def sent_by(line):
    """Return a list that collects the telegrams that masters send on a line from now on."""
    sent = []
    line.monitors.append(lambda told: sent.append(told.data) if told.sender is None else None)
    return sent


@pytest.mark.parametrize(
    ("model", "maximum", "raw", "reference"),
    [
        ("delta", "0x0100", 5000, "0x2001"),
        ("schneider-atv", "3104", 500, "8502"),
        ("toshiba-vfs11", "0x0012", 5000, "0xFA01"),
    ],
)
def test_percent_refers_to_the_maximum_frequency(drive_of, model, maximum, raw, reference):
    virtual, drive = drive_of(model)
    virtual.poke(maximum, raw)
    assert drive.capabilities.reference_percent
    drive.set_reference(percent=Decimal("50.005"))
    # 25.0025 Hz, rounded to the nearest step
    assert drive.read(reference).value == Decimal(25)


def test_percent_is_refused_if_the_maximum_frequency_is_zero(drive_of):
    virtual, drive = drive_of("delta")
    virtual.poke("0x0100", 0)
    with pytest.raises(StateError, match="maximum frequency is 0"):
        drive.set_reference(percent=50)
    assert drive.read("0x2001").raw == 0


MODBUS = installed["modbus"]
ORDERED = [
    name
    for name in model_names("drivecomm_modbus", "modbus")
    if not is_monitoring_only(MODBUS, load_model("drivecomm_modbus", "modbus", name))
]
FORMS = ({"percent": 40}, {"hz": 20})


@pytest.mark.parametrize("model", ORDERED)
@pytest.mark.parametrize("form", FORMS, ids=lambda form: next(iter(form)))
def test_unsupported_form_of_reference_is_refused_with_the_needed_option(drive_of, model, form):
    _, drive = drive_of(model)
    able = drive.capabilities
    if able.reference_percent if "percent" in form else able.reference_hz:
        drive.set_reference(**form)
        return
    sent = sent_by(drive_of.line)
    with pytest.raises(NotSupported, match=f"{model} .* only; give .* reference_maximum_hz=50, to set it in") as caught:
        drive.set_reference(**form)
    assert caught.value.says == ("reference_maximum_hz=50",)
    assert sent == []


@pytest.mark.parametrize("model", ORDERED)
def test_both_forms_give_the_same_reference_with_the_option(drive_of, model):
    _, drive = drive_of(model, reference_maximum_hz=50)
    able = drive.capabilities
    assert able.reference_percent
    assert able.reference_hz
    control = drive.model.control
    held = []
    for form in FORMS:
        drive.set_reference(**form)
        held.append(drive.read(control.get("reference_percent") or control["reference_hz"]).raw)
    assert held[0] == held[1] > 0


@pytest.mark.parametrize("model", ORDERED)
@pytest.mark.parametrize("form", [{"percent": "100.01"}, {"percent": -101}, {"hz": "50.01"}, {"hz": -51}])
def test_neither_form_exceeds_the_maximum_of_the_option(drive_of, model, form):
    _, drive = drive_of(model, reference_maximum_hz=50)
    sent = sent_by(drive_of.line)
    with pytest.raises(ValueRefusedError):
        drive.set_reference(**form)
    assert sent == []


@pytest.mark.parametrize(
    ("model", "held", "hz", "percent"),
    [
        ("siemens-v20", {"40016": 6000}, 45, 75),
        ("siemens-v20", {}, Decimal("12.5"), 25),
        ("vacon10", {"101": 1000, "102": 6000}, 35, 50),
        ("vacon10", {"101": 1000}, 10, 0),
    ],
)
def test_hertz_are_scaled_by_the_full_scale_of_the_drive(drive_of, model, held, hz, percent):
    virtual, drive = drive_of(model)
    for address, raw in held.items():
        virtual.poke(address, raw)
    drive.set_reference(hz=hz)
    assert drive.read(drive.model.control["reference_percent"]).value == percent
    drive.start()
    drive_of.line.advance(60)
    assert drive.read(drive.model.control["actual_percent"]).value == pytest.approx(
        Decimal(percent), abs=Decimal("0.01")
    )
    assert virtual.motor.output_hz == pytest.approx(float(hz))


@pytest.mark.parametrize(
    ("model", "held", "hz"),
    [("siemens-v20", {"40016": 4000}, 41), ("vacon10", {"102": 4000}, 41), ("vacon10", {"101": 1000}, 9)],
)
def test_hertz_outside_the_range_of_the_drive_are_refused(drive_of, model, held, hz):
    virtual, drive = drive_of(model)
    for address, raw in held.items():
        virtual.poke(address, raw)
    with pytest.raises(ValueRefusedError, match=next(iter(held))):
        drive.set_reference(hz=hz)
    assert drive.read(drive.model.control["reference_percent"]).raw == 0


def test_hertz_are_refused_if_the_full_scale_is_zero(drive_of):
    virtual, drive = drive_of("siemens-v20")
    virtual.poke("40016", 0)
    with pytest.raises(StateError, match=r"parameter 40016.*use per cent"):
        drive.set_reference(hz=10)


def test_option_overrides_the_full_scale_of_the_drive(drive_of):
    virtual, drive = drive_of("siemens-v20", reference_maximum_hz=100)
    virtual.poke("40016", 5000)
    drive.set_reference(hz=50)
    assert drive.read("40003").value == 50


def test_minimum_of_the_options_is_zero_per_cent(drive_of):
    _, drive = drive_of("danfoss-fc", reference_minimum_hz=10, reference_maximum_hz=50)
    drive.set_reference(hz=30)
    assert drive.read("50010").value == 50
    with pytest.raises(ValueRefusedError, match="outside 10 to 50 Hz"):
        drive.set_reference(hz=5)


def test_percent_above_the_maximum_frequency_of_the_drive_is_refused(drive_of):
    virtual, drive = drive_of("delta", reference_maximum_hz=100)
    virtual.poke("0x0100", 6000)
    drive.set_reference(percent=60)
    assert drive.read("0x2001").value == 60
    with pytest.raises(ValueRefusedError, match=r"61 % of 100 Hz is above 60\.00 Hz.*0x0100"):
        drive.set_reference(percent=61)


@pytest.mark.parametrize(
    "options",
    [
        {"reference_maximum_hz": 0},
        {"reference_maximum_hz": 10, "reference_minimum_hz": 10},
        {"reference_minimum_hz": -1},
    ],
)
def test_empty_reference_range_of_the_options_is_refused(drive_of, options):
    with pytest.raises(UsageError, match="reference_maximum_hz"):
        drive_of("yaskawa", **options)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"maximum": "0x0100"}, "write { maximum"),
        ({"maximum": "0x0100", "source": ""}, "write { maximum"),
        ({"maximum": "0x7777", "source": "manual p. 1"}, "'0x7777' is not a parameter"),
        ({"maximum": "0x2101", "source": "manual p. 1"}, "0x2101 is in no unit, not in Hz"),
        ({"maximum": "0x0100", "source": "manual p. 1"}, "reference_percent, which is missing"),
    ],
)
def test_invalid_full_scale_of_a_model_is_refused(given, complaint):
    model = load_model("drivecomm_modbus", "modbus", "delta-vfd-b")
    with pytest.raises(UsageError, match=complaint):
        full_scale_of(replace(model, control={**model.control, "full_scale": given}))
