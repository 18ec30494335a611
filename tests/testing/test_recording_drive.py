"""Addressing of a recording drive: which requests count as received."""

import pytest
from addressed_requests import ADDRESSED, framed

from drivecomm.protocol import installed
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.virtual import virtual_drive


@pytest.mark.parametrize(("protocol", "address", "fields"), ADDRESSED)
def test_request_is_recorded_only_by_its_addressee(protocol, address, fields):
    plugin, find = installed[protocol], framed(protocol, fields)
    for at, received in ((address, 1), (plugin.addresses[-1], 0)):
        record = Record()
        RecordingDrive(plugin, virtual_drive(protocol, at), record).hear(find, 1.0)
        assert len(record.received) == received
