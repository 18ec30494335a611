"""What a judged drive counts as heard."""

import pytest
from addressed_requests import ADDRESSED, framed

from drivecomm.judge.drive import JudgedDrive
from drivecomm.protocol import installed
from drivecomm.virtual import virtual_drive


@pytest.mark.parametrize(("protocol", "address", "fields"), ADDRESSED)
def test_request_is_heard_by_the_drive_that_it_is_for(protocol, address, fields):
    plugin, find = installed[protocol], framed(protocol, fields)
    for at, heard in ((address, 1), (plugin.addresses[-1], 0)):
        judged = JudgedDrive(plugin, virtual_drive(protocol, at), None)
        judged.hear(find, 1.0)
        assert len(judged.heard) == heard
