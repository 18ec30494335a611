"""Refusal code of a Modbus drive for an unknown register, which its model defines."""

import pytest
from proved_drives import model

from drivecomm.protocol import installed, resolve_options


@pytest.mark.parametrize(("name", "code"), [("enc-eds", 3), ("yaskawa", 2)])
def test_address_space_uses_the_models_code_for_unknown_registers(name, code):
    plugin, known = installed["modbus"], model("modbus", name)
    options = resolve_options(plugin, known, {})[1]
    assert plugin.address_space(options, known).absent == {code}
