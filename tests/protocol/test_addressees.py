"""Whom a request is for, as recordings, judges, plants and the cohabitation check see it."""

import pytest

from drivecomm.judge.drive import JudgedDrive
from drivecomm.protocol import DriveConfig, Framed, installed
from drivecomm.testing.recording import Record, RecordingDrive
from drivecomm.traffic.cohabitation import partners_of
from drivecomm.virtual import virtual_drive

FOR_ITS_GROUP = [
    ("lecom", 11, {"kind": "send", "address": 10, "code": 46, "data": "10"}),
    ("ct-ansi", 12, {"kind": "write", "group": 1, "unit": 0, "menu": 1, "parameter": 21, "data": "+10.0"}),
]
FOR_ONE = [
    ("mitsubishi", 1, {"kind": "read", "station": 1, "code": "6F", "wait": 0}),
    ("hitachi", 1, {"kind": "status", "node": 1}),
    ("lecom", 11, {"kind": "receive", "address": 11, "code": 46}),
    ("ct-ansi", 12, {"kind": "read", "group": 1, "unit": 2, "menu": 1, "parameter": 21}),
]


def framed(protocol, fields):
    plugin = installed[protocol]
    message = plugin.message(fields, "request")
    return Framed(plugin.codec(plugin.options()).encode(message), message)


@pytest.mark.parametrize(("protocol", "address", "fields"), FOR_ITS_GROUP + FOR_ONE)
def test_request_is_counted_where_it_is_meant(protocol, address, fields):
    plugin, find, counted = installed[protocol], framed(protocol, fields), []
    for at in (address, plugin.addresses[-1]):
        record = Record()
        recording = RecordingDrive(plugin, virtual_drive(protocol, at), record)
        judged = JudgedDrive(plugin, virtual_drive(protocol, at), None)
        recording.hear(find, 1.0)
        judged.hear(find, 1.0)
        assert len(record.received) == len(judged.heard)
        counted.append(len(judged.heard))
    assert counted == [1, 0]


@pytest.mark.parametrize(("protocol", "address", "fields"), FOR_ITS_GROUP + FOR_ONE)
def test_listener_of_a_line_takes_what_is_meant_for_it(protocol, address, fields):
    message = framed(protocol, fields).message
    drives = (DriveConfig(protocol=protocol, address=at) for at in (address, installed[protocol].addresses[-1]))
    assert [partner.is_meant(message) for partner in partners_of(drives)] == [True, False]
