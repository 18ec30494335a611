"""Requests that only read: a request that could command or write never counts as harmless."""

from contextlib import suppress
from dataclasses import replace
from decimal import Decimal

import pytest
from addresses import address_of
from benches import COMMANDED

from drivecomm.bus import open_bus
from drivecomm.errors import NotSupported
from drivecomm.models import load_model
from drivecomm.protocol import Ask, Tell, installed
from drivecomm.testing import packaged_vectors
from drivecomm.traffic.replay import decoded_requests, only_asks, request_as_text
from drivecomm.virtual import VirtualLine, drive_type, virtual_drive
from drivecomm_danfoss_fc.messages import ParameterRequest, ProcessRequest, TextRequest
from drivecomm_fuji.telegrams import PollFrame, SelectFrame as FujiSelect, StandardFrame
from drivecomm_vabus.telegrams import Enquiry, Eot, Select
from drivecomm_vlt3500.messages import Control, Read, ReadIndex, Update

EVERYBODY = list(installed.working())
_FC = {"address_format": "1-31", "address": 3, "reference": 0}
_PARAMETER = {**_FC, "pnu": 1630, "ind": 0, "pwe": 0}

FAULTS = {
    "vabus": 0x0300,
    "danfoss-fc": 14,
    "vlt3500": 5,
    "fuji": 3,
    "modbus": 14,
    "uss": 11,
    "huanyang": 1,
    "mitsubishi": 16,
    "movilink": 11,
    "hitachi": 7,
    "ls-bus": 2,
    "ct-ansi": 3,
    "toshiba": 5,
}

CASES = [
    ("vabus", Enquiry(address=1, parameter=481), True),
    ("vabus", Eot(), True),
    ("vabus", Select(address=1, parameter=480, data="0005"), False),
    ("danfoss-fc", ProcessRequest(**_FC, control_word=0), True),
    ("danfoss-fc", ProcessRequest(**_FC, control_word=0x007C), True),
    ("danfoss-fc", ProcessRequest(**_FC, control_word=0x047C), False),
    ("danfoss-fc", ProcessRequest(**_FC, control_word=0x043C), False),
    ("danfoss-fc", ParameterRequest(**_PARAMETER, ak=1, control_word=0), True),
    ("danfoss-fc", ParameterRequest(**_PARAMETER, ak=1, control_word=0x0400), False),
    ("danfoss-fc", ParameterRequest(**_PARAMETER, ak=4, control_word=0), True),
    ("danfoss-fc", ParameterRequest(**{**_PARAMETER, "ind": 0x0400}, ak=15, control_word=0), True),
    ("danfoss-fc", ParameterRequest(**{**_PARAMETER, "ind": 0x0500}, ak=15, control_word=0), False),
    *[
        ("danfoss-fc", ParameterRequest(**_PARAMETER, ak=ak, control_word=0), False)
        for ak in (2, 3, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14)
    ],
    ("danfoss-fc", TextRequest(**_FC, ak=15, pnu=533, ind=0x0500, text="A", control_word=0), False),
    ("vlt3500", Read(address=1, parameter=516), True),
    ("vlt3500", ReadIndex(address=1, parameter=602, index=(13, 5)), True),
    ("vlt3500", Control(address=1, control_word=0), True),
    ("vlt3500", Control(address=1, control_word=0x047F), False),
    ("vlt3500", Control(address=1, control_word=0, control_mask=0x000F), False),
    ("vlt3500", Read(address=1, parameter=516, control_word=0x0400), False),
    ("vlt3500", Update(address=1, parameter=516, value=Decimal(1)), False),
    ("fuji", StandardFrame(kind="request", address=1, command="R", function="M09"), True),
    ("fuji", StandardFrame(kind="request", address=1, command="W", function="S06", data=1), False),
    ("fuji", StandardFrame(kind="request", address=1, command="A", function="S06", data=1), False),
    ("fuji", StandardFrame(kind="request", address=1, command="E"), False),
    ("fuji", PollFrame(kind="request", address=1, command="j"), True),
    ("fuji", FujiSelect(kind="request", address=1, command="m", data=0), False),
]


@pytest.mark.parametrize(("name", "message", "asks"), CASES, ids=str)
def test_intent_only_asks_is_true_for_reads_only(name, message, asks):
    plugin = installed[name]
    assert plugin.intent(message).only_asks is asks


def _asked(exchange):
    """Return the messages that an exchange sends up to its first reply."""
    found, command = [], next(exchange)
    while not isinstance(command, Ask):
        if isinstance(command, Tell):
            found.append(command.message)
        command = exchange.send(None)
    return [*found, command.message]


@pytest.mark.parametrize("plugin", EVERYBODY, ids=lambda plugin: plugin.name)
def test_intent_of_probes_and_reads_is_to_ask_only(plugin):
    model = load_model(plugin.package, plugin.name, plugin.default_model)
    address = address_of(plugin.name)
    options = drive_type(plugin.name, address, model=model, options={}).options
    operations = plugin.operations(address, options, model)
    for exchange in (operations.probe(), operations.read(plugin.parameter_examples[0])):
        for message in _asked(exchange):
            assert plugin.intent(message).only_asks, message
    with suppress(NotSupported):  # a model may have no status
        for message in _asked(operations.status()):
            assert plugin.intent(message).only_asks, message


@pytest.mark.parametrize("plugin", [installed[name] for name in COMMANDED], ids=lambda plugin: plugin.name)
@pytest.mark.parametrize("verb", ["start", "stop", "reset", "reference"])
def test_every_command_has_a_telegram_that_commands(plugin, verb):
    address = address_of(plugin.name)
    line = VirtualLine([virtual_drive(plugin.name, address)])
    if verb == "reset":
        # A drive without a trip gets only reads.
        line.drives[0].trip(FAULTS[plugin.name], 0.0)
        line.advance(20)
    sent = []
    with open_bus(line.port, trace=lambda event: sent.append(event) if event.what == "sent" else None) as bus:
        drive = bus.drive(plugin.name, address, model=plugin.default_model)
        if verb == "reset" and not drive.capabilities.faults:
            return
        share = {"percent": 10} if drive.capabilities.reference_percent else {"hz": 5}
        if verb == "start" and drive.capabilities.reference_percent:
            drive.set_reference(percent=10)
            sent.clear()
        drive.set_reference(**share) if verb == "reference" else getattr(drive, verb)()
    assert any(not only_asks(event.data, EVERYBODY) for event in sent)


def _packaged_requests():
    for plugin in EVERYBODY:
        for vector in packaged_vectors(plugin).vectors:
            if vector.valid and vector.direction == "request" and not vector.options:
                yield pytest.param(plugin, vector, id=f"{plugin.name}-{vector.id}")


@pytest.mark.parametrize(("plugin", "vector"), [*_packaged_requests()])
def test_packaged_requests_are_decoded_and_judged(plugin, vector):
    found = {each.name: message for each, message in decoded_requests(vector.data, EVERYBODY)}
    assert plugin.name in found
    assert only_asks(vector.data, EVERYBODY) <= plugin.intent(found[plugin.name]).only_asks


def test_only_asks_is_false_for_bytes_that_are_not_a_request():
    assert not only_asks(b"", EVERYBODY)
    assert not only_asks(b"hello", EVERYBODY)
    assert not only_asks(bytes.fromhex("04 41 30 30 34 38 31 05"), [])


def test_protocol_without_intent_is_not_trusted():
    silent = replace(installed["vabus"], intent=None)
    assert not only_asks(bytes.fromhex("04 41 30 30 34 38 31 05"), [silent])


def test_request_as_text_shows_bytes_drive_and_kind():
    assert (
        request_as_text(bytes.fromhex("04 41 30 30 34 38 31 05"), EVERYBODY)
        == "04 41 30 30 34 38 31 05 (vabus:1 enquiry)"
    )
    assert request_as_text(bytes.fromhex("04"), EVERYBODY) == "04 (vabus eot)"
    assert request_as_text(b"?!", EVERYBODY) == "3F 21"
