"""Calls and writes that may start a motor, judged by their effect, on every protocol."""

import pytest
from addresses import address_of

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

CASES = [
    # (protocol, model, verb, arguments, may start)
    ("vabus", "agile", "call", {"verb": "control_word", "word": 0x000F}, True),
    ("vabus", "agile", "call", {"verb": "control_word", "word": 0x0002}, True),
    ("vabus", "agile", "call", {"verb": "control_word", "word": 0}, False),
    ("vabus", "agile", "write", {"parameter": "410", "value": 15}, True),
    ("vabus", "agile", "write", {"parameter": "410", "value": "7", "store": True}, True),
    ("vabus", "agile", "write", {"parameter": "control_word", "value": 15}, True),
    ("vabus", "agile", "write", {"parameter": "410", "value": 0}, False),
    ("vabus", "agile", "write", {"parameter": "18", "value": "00"}, True),
    ("vabus", "agile", "write", {"parameter": "480", "value": 20}, False),
    ("vabus", None, "write", {"parameter": "410", "value": 15, "type": "uint"}, True),
    ("danfoss-fc", "fc300", "call", {"verb": "jog"}, True),
    ("danfoss-fc", "fc300", "call", {"verb": "control_word", "word": 0x047C}, True),
    ("danfoss-fc", "fc300", "call", {"verb": "control_word", "word": 0x053C}, True),
    ("danfoss-fc", "fc300", "call", {"verb": "control_word", "word": 0x043C}, False),
    ("danfoss-fc", "fc300", "call", {"verb": "control_word", "word": 0x007C}, False),
    ("danfoss-fc", "fc300", "call", {"verb": "control_word"}, True),
    ("danfoss-fc", "fc300", "call", {"verb": "describe", "parameter": "3-41"}, False),
    ("danfoss-fc", "fc300", "call", {"verb": "select_preset", "number": 2}, False),
    ("danfoss-fc", "fc300", "write", {"parameter": "3-41", "value": 5}, False),
    ("uss", "micromaster4", "call", {"verb": "control_word", "word": 0x047F}, True),
    ("uss", "micromaster4", "call", {"verb": "control_word", "word": 0x047E}, False),
    ("uss", "micromaster4", "call", {"verb": "release"}, False),
    ("vlt3500", "vlt3500", "call", {"verb": "jog", "number": 2}, True),
    ("vlt3500", "vlt3500", "call", {"verb": "control_word", "word": 0x047F}, True),
    ("vlt3500", "vlt3500", "call", {"verb": "control_word", "word": 0x0400, "mask": 0x0F00}, True),
    ("vlt3500", "vlt3500", "write", {"parameter": "516", "value": 20}, False),
    ("fuji", "frenic", "write", {"parameter": "S06", "value": 1}, True),
    ("fuji", "frenic", "write", {"parameter": "S06", "value": 0}, False),
    ("fuji", "frenic", "write", {"parameter": "S05", "value": 20}, False),
    ("fuji", "frenic", "call", {"verb": "terminals", "X1": True}, True),
    ("fuji", "frenic", "call", {"verb": "terminals", "X1": False}, False),
    ("fuji", "frenic", "call", {"verb": "digital_outputs", "Y1": True}, False),
    ("huanyang", "hy", "write", {"parameter": "CFG0", "value": 20}, False),
    ("modbus", "delta", "write", {"parameter": "0x2000", "value": 0x12}, True),
    ("modbus", "delta", "write", {"parameter": "0x2000", "value": 0x02}, True),
    ("modbus", "delta", "write", {"parameter": "operation_command", "value": 3}, True),
    ("modbus", "delta", "write", {"parameter": "0x2000", "value": 1}, False),
    ("modbus", "delta", "write", {"parameter": "0x1FFF", "value": 0x12, "type": "u32"}, True),
    ("modbus", "delta", "write", {"parameter": "0x2001", "value": 20}, False),
    ("modbus", "danfoss-fc", "write", {"parameter": "50000", "value": 0x047C}, True),
    ("modbus", "danfoss-fc", "write", {"parameter": "50000", "value": 0x053C}, True),
    ("modbus", "danfoss-fc", "write", {"parameter": "50000", "value": 0x043C}, False),
    ("modbus", "danfoss-fc", "write", {"parameter": "c7", "value": 1}, True),
    ("modbus", "danfoss-fc", "write", {"parameter": "c65", "value": 1}, False),
    ("modbus", "siemens-v20", "write", {"parameter": "40100", "value": 0x047F}, True),
    ("modbus", "siemens-v20", "write", {"parameter": "40004", "value": 1}, True),
    ("modbus", "abb-acs355", "write", {"parameter": "40031", "value": 2}, True),
    ("modbus", "hitachi-wj200", "write", {"parameter": "c0x01", "value": 1}, True),
    ("modbus", "hitachi-wj200", "write", {"parameter": "c0x01", "value": 0}, False),
]


@pytest.mark.parametrize(("protocol", "model", "verb", "arguments", "starts"), CASES)
def test_may_start_recognises_calls_that_turn_a_motor(protocol, model, verb, arguments, starts):
    line = VirtualLine([virtual_drive(protocol, 1, model=model)])
    sent = []
    line.monitors.append(sent.append)
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive(protocol, 1, model=model).may_start(verb, **arguments) is starts
        if verb == "write":
            assert bus.drive(protocol, 1, model=model).may_start("write_and_read", **arguments) is starts
    assert sent == []


@pytest.mark.parametrize("verb", ["start", "reverse", "jog"])
def test_start_reverse_and_jog_may_start_every_drive(verb):
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive("vabus", 1).may_start(verb)
        assert not bus.drive("vabus", 1).may_start("set_reference", percent=20)


def test_read_only_drive_never_may_start():
    line = VirtualLine([virtual_drive("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        assert not bus.drive("danfoss-fc", 1, read_only=True).may_start("call", verb="describe", parameter="3-41")


EVERY = [(name, model) for name in sorted(installed) for model in model_names(installed[name].package, name)]


@pytest.mark.parametrize(("name", "model"), EVERY)
def test_parameters_outside_may_start_turn_no_motor(name, model):
    """After a write that `may_start` declares harmless, the standing virtual motor must not turn."""
    parameters = load_model(installed[name].package, name, model).parameters
    line = VirtualLine([virtual_drive(name, address_of(name), model=model)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(name, address_of(name), model=model)
        able = drive.capabilities
        try:
            drive.set_reference(**({"percent": 50} if able.reference_percent else {"hz": 20}))
        except DriveCommError:
            pytest.skip("takes no reference")
        for address, info in parameters.items():
            for value in (1, 2, 3, 15, 0x047F, 0x047C):
                given = {"parameter": address, "value": value * info.factor, "store": info.storage == "stored"}
                try:
                    starts = drive.may_start("write", **given)
                    if starts or (info.kind == "command" and info.unit):
                        continue
                    drive.write(given["parameter"], given["value"], store=given["store"])
                except DriveCommError:
                    continue
                line.advance(1)
                virtual = line.drives[0]
                virtual.motor.advance(line.time)
                assert virtual.motor.output_hz == 0, f"{address} := {value}"
