"""Requests for one drive or for its group: protocol, address of the drive, and fields of the request."""

from drivecomm.protocol import Framed, installed

ADDRESSED = [
    ("lecom", 11, {"kind": "send", "address": 10, "code": 46, "data": "10"}),
    ("ct-ansi", 12, {"kind": "write", "group": 1, "unit": 0, "menu": 1, "parameter": 21, "data": "+10.0"}),
    ("mitsubishi", 1, {"kind": "read", "station": 1, "code": "6F", "wait": 0}),
    ("hitachi", 1, {"kind": "status", "node": 1}),
    ("lecom", 11, {"kind": "receive", "address": 11, "code": 46}),
    ("ct-ansi", 12, {"kind": "read", "group": 1, "unit": 2, "menu": 1, "parameter": 21}),
]


def framed(protocol, fields):
    plugin = installed[protocol]
    message = plugin.message(fields, "request")
    return Framed(plugin.codec(plugin.options()).encode(message), message)
