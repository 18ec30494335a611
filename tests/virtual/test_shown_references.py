"""Virtual drives show the reference that they received, for every model with a common name for it."""

import pytest
from addresses import address_of

import drivecomm
from drivecomm.errors import NotSupported
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

CASES = [
    (protocol, model)
    for protocol in sorted(installed)
    for model in model_names(installed[protocol].package, protocol)
    if {"reference_frequency", "reference_percent"}
    & load_model(installed[protocol].package, protocol, model).quantities.keys()
]

UNNAMED = {"vlt3500": "502[1]"}  # output frequency of models without a name for it, as its scale is unconfirmed
UNKNOWN = {"ct-ansi"}  # no page says which parameter is their output frequency


@pytest.mark.parametrize(("protocol", "model"), CASES)
def test_reference_under_its_common_name_is_the_commanded_one(protocol, model):
    known = load_model(installed[protocol].package, protocol, model)
    line = VirtualLine([virtual_drive(protocol, address_of(protocol), model=known)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, address_of(protocol), model=model, confirmed=model)
        for percent, hz in ((40, 20), (60, 30)):
            try:
                if drive.capabilities.reference_hz:
                    drive.set_reference(hz=hz)
                else:
                    drive.set_reference(percent=percent)
            except NotSupported:
                assert not drive.capabilities.volatile_writes, "only a drive whose references would be stored has none"
                return
            drive.start()
            line.advance(30)
            if protocol in UNKNOWN:
                line.drives[0].motor.advance(line.time)
                ordered = line.drives[0].motor.output_hz
            else:
                shown = "output_frequency" if "output_frequency" in known.quantities else UNNAMED[protocol]
                ordered = float(drive.read(shown).value)
            if "reference_frequency" in known.quantities:
                assert float(drive.read("reference_frequency").value) == pytest.approx(ordered, abs=0.1)
            if "reference_percent" in known.quantities:
                assert float(drive.read("reference_percent").value) == pytest.approx(percent, abs=0.1)
