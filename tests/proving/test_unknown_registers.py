"""The code with which a Modbus drive refuses a register that it does not have is that of its model."""

import pytest
from proved_drives import model

from drivecomm.protocol import installed, resolve_options


@pytest.mark.parametrize(("name", "code"), [("enc-eds", 3), ("yaskawa", 2)])
def test_address_space_takes_the_code_for_an_unknown_register_from_the_model(name, code):
    plugin, known = installed["modbus"], model("modbus", name)
    options = resolve_options(plugin, known, {})[1]
    assert plugin.address_space(options, known).absent == {code}
