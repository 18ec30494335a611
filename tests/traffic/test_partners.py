"""The telegrams that a drive on a shared line takes for its own."""

import pytest
from addressed_requests import ADDRESSED, framed

from drivecomm.protocol import DriveConfig, installed
from drivecomm.traffic.cohabitation import line_drives_of


@pytest.mark.parametrize(("protocol", "address", "fields"), ADDRESSED)
def test_drive_on_a_shared_line_accepts_only_messages_for_its_address(protocol, address, fields):
    message = framed(protocol, fields).message
    drives = (DriveConfig(protocol=protocol, address=at) for at in (address, installed[protocol].addresses[-1]))
    assert [partner.is_meant(message) for partner in line_drives_of(drives)] == [True, False]
