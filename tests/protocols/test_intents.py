"""Intents of requests: whether they read or write a parameter, and whether they command."""

import pytest

from drivecomm.models import load_model
from drivecomm.protocol import Intent, installed
from drivecomm.testing import packaged_vectors

PLUGINS = list(installed.working())
each_protocol = pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)

# Enough examples to see that requests of each protocol are classified correctly.
KNOWN = {
    "vabus": [({"kind": "enquiry"}, "read"), ({"kind": "select"}, "write"), ({"kind": "eot"}, "")],
    "danfoss-fc": [
        ({"kind": "process"}, ""),
        ({"kind": "parameter", "ak": 0}, ""),
        ({"kind": "parameter", "ak": 1}, "read"),
        ({"kind": "parameter", "ak": 4}, "read"),
        ({"kind": "parameter", "ak": 2}, "write"),
        ({"kind": "parameter", "ak": 14}, "write"),
    ],
    "hitachi": [
        ({"kind": "read"}, "read"),
        ({"kind": "history"}, "read"),
        ({"kind": "write"}, "write"),
        ({"kind": "run"}, "write"),
        ({"kind": "terminals"}, "write"),
        ({"kind": "initialise"}, ""),
    ],
    "huanyang": [
        ({"function": 1}, "read"),
        ({"function": 4}, "read"),
        ({"function": 2}, "write"),
        ({"function": 3}, ""),
        ({"function": 5}, "write"),
    ],
    "mitsubishi": [({"kind": "read"}, "read"), ({"code": "FA"}, "write"), ({"kind": "multi"}, "write")],
    "movilink": [
        ({"type": 0x86, "management": 0x31}, "read"),
        ({"type": 0x86, "management": 0x33}, "write"),
        ({"type": 3}, ""),
    ],
    "toshiba": [({"command": "R"}, "read"), ({"command": "W"}, "write"), ({"command": "P"}, "write")],
    "uss": [({"ak": 0}, ""), ({"ak": 1}, "read"), ({"ak": 6}, "read"), ({"ak": 2}, "write"), ({"ak": 11}, "write")],
    "vlt3500": [
        ({"kind": "update"}, "write"),
        ({"kind": "read"}, "read"),
        ({"kind": "read_index"}, "read"),
        ({"kind": "control"}, ""),
    ],
    "ct-ansi": [
        ({"kind": "read"}, "read"),
        ({"kind": "write"}, "write"),
        ({"kind": "repeat"}, "read"),
        ({"kind": "rewrite"}, "write"),
    ],
    "weg": [({"kind": "read"}, "read"), ({"kind": "write"}, "write"), ({"kind": "end"}, "")],
    "ei-bisynch": [({"kind": "enquiry"}, "read"), ({"kind": "selection"}, "write")],
    "lecom": [({"kind": "receive"}, "read"), ({"kind": "send"}, "write")],
    "ls-bus": [
        ({"kind": "read"}, "read"),
        ({"kind": "write"}, "write"),
        ({"kind": "register"}, ""),
        ({"kind": "monitor"}, "read"),
    ],
    "modbus": [
        ({"function": 3}, "read"),
        ({"function": 6}, "write"),
        ({"function": 0x17}, "write"),
        ({"function": 8}, ""),
    ],
    "fuji": [
        ({"frame": "standard", "command": "R"}, "read"),
        ({"frame": "standard", "command": "W"}, "write"),
        ({"frame": "standard", "command": "E"}, ""),
        ({"frame": "select", "command": "m"}, ""),
        ({"frame": "select", "command": "f"}, "write"),
        ({"frame": "poll"}, "read"),
    ],
}


@each_protocol
def test_requests_of_the_vectors_have_the_expected_intent(plugin):
    seen = set()
    for vector in packaged_vectors(plugin).vectors:
        if vector.direction != "request" or not vector.valid:
            continue
        intent = plugin.intent(plugin.message(vector.fields, "request"))
        for fields, wanted in KNOWN[plugin.name]:
            if all(
                vector.fields.get(name, "standard" if name == "frame" else None) == value
                for name, value in fields.items()
            ):
                assert intent.access == wanted, vector
                seen.add(str(fields))
    assert len(seen) >= 2


@each_protocol
def test_read_verb_sends_a_request_with_the_intent_to_read(plugin):
    operations = plugin.operations(
        plugin.addresses[1], plugin.options(), load_model(plugin.package, plugin.name, plugin.default_model)
    )
    for parameter in plugin.parameter_examples[:2]:
        assert plugin.intent(next(operations.read(parameter)).message) == Intent(access="read")
