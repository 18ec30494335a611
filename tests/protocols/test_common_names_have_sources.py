"""Sources of common names: a page, a program or a related page confirms each of them in these models."""

import pytest

from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed

# Each model of these protocols except `guesses`, whose facts are guesses by design.
MODELS = {
    f"{protocol}/{name}": load_model(installed[protocol].package, protocol, name)
    for protocol in ("danfoss-fc", "uss", "fuji", "vlt3500", "vabus", "hitachi", "huanyang", "toshiba", "weg", "ls-bus")
    for name in model_names(installed[protocol].package, protocol)
    if name != "guesses"
} | {
    f"modbus/{name}": load_model(installed["modbus"].package, "modbus", name)
    for name in ("danfoss-fc", "bonfiglioli", "siemens-g120", "siemens-v20", "mitsubishi", "fuji-frenic")
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_common_name_does_not_rest_on_an_unconfirmed_fact(model):
    unconfirmed = {name for name, at in model.quantities.items() if model.parameters[at].sure == "unconfirmed"}
    assert not unconfirmed


@pytest.mark.parametrize(
    ("name", "parameter", "raw", "value"),
    [
        # LinuxCNC component vlt5000_vfd: the factors of its macros READ_VLT_...
        ("vlt5000", "520", 820, "8.20"),
        ("vlt5000", "521", -600, "-60.0"),
        ("vlt5000", "522", 400, "4.00"),
        ("vlt5000", "537", 42, "42"),
        # VLT 2800/6000/8000 Modbus RTU manual MG.10.S2.02 p. 30: 738 is 7.38 A
        ("vlt5000", "105", 738, "7.38"),
        # SZARP, driver borutadmn fc: DC link voltage of a VLT 6000 is 518, without decimals
        ("vlt6000", "518", 540, "540"),
    ],
)
def test_old_vlt_parameter_has_the_factor_of_its_source(name, parameter, raw, value):
    info = MODELS[f"danfoss-fc/{name}"].parameters[parameter]
    assert str(raw * info.factor) == value
