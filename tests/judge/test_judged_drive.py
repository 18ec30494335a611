"""Requests that a judged drive records."""

import pytest
from addressed_requests import ADDRESSED, framed

from drivecomm.judge.judged_drive import JudgedDrive
from drivecomm.protocol import installed
from drivecomm.virtual import virtual_drive


@pytest.mark.parametrize(("protocol", "address", "fields"), ADDRESSED)
def test_request_is_recorded_only_by_its_addressee(protocol, address, fields):
    plugin, find = installed[protocol], framed(protocol, fields)
    for at, heard in ((address, 1), (plugin.addresses[-1], 0)):
        judged = JudgedDrive(plugin, virtual_drive(protocol, at), None)
        judged.hear(find, 1.0)
        assert len(judged.heard) == heard
