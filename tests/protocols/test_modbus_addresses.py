"""Addresses beyond 247, where the standard ends: for drives whose model says that they can have them."""

import pytest

import drivecomm
from drivecomm.bus import scan_plan
from drivecomm.errors import AddressError, TelegramError, UsageError
from drivecomm.models import load_model
from drivecomm.protocol import installed, resolve_options
from drivecomm.protocol.schema import crc16
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_modbus.messages import Request


def codec_of(model=None, **given):
    plugin = installed["modbus"]
    known = None if model is None else load_model(plugin.package, "modbus", model)
    return plugin.codec(resolve_options(plugin, known, given)[1])


@pytest.mark.parametrize(("model", "highest"), [("delta", 254), ("delta-vfd-b", 254), ("delta-vfd-e", 254)])
def test_a_drive_has_the_address_that_its_model_allows(model, highest):
    line = VirtualLine([virtual_drive("modbus", highest, model=model), virtual_drive("modbus", 1, model="gs2")])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", highest, model=model)
        assert drive.read("output_frequency").value == 0
        drive.set_reference(hz=20)
        drive.start()
        line.advance(30)
        assert drive.status().running
        with pytest.raises(AddressError, match=f"addresses are 1 to {highest}"):
            bus.drive("modbus", highest + 1, model=model)


@pytest.mark.parametrize("model", [None, "gs2", "yaskawa", "schneider-atv"])
def test_other_drives_end_at_247(model):
    line = VirtualLine([virtual_drive("modbus", 247, model="gs2")])
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("modbus", 247, model=model)
        with pytest.raises(AddressError, match="addresses are 1 to 247"):
            bus.drive("modbus", 248, model=model)
    with pytest.raises(AddressError, match="1 to 247"):
        virtual_drive("modbus", 248, model="gs2")


def test_whoever_knows_a_drive_may_say_so_himself():
    line = VirtualLine([virtual_drive("modbus", 255, model="gs2", highest_address=255)])
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive("modbus", 255, model="gs2", highest_address=255).read("output_frequency").value == 0
        for beyond in (0, 256):
            with pytest.raises(UsageError, match=f"highest_address of {beyond} is not 1 to 255"):
                bus.drive("modbus", 1, highest_address=beyond)


@pytest.mark.parametrize("direction", ["request", "reply"])
def test_telegrams_follow_the_model(direction):
    data = bytes.fromhex("F8 06 00 00 00 00")
    data += crc16(data)
    with pytest.raises(TelegramError) as caught:
        codec_of().decode(data, direction)
    assert (caught.value.category, caught.value.field) == ("field", "address")
    assert codec_of("delta").decode(data, direction).address == 248
    with pytest.raises(TelegramError):
        codec_of().encode(Request(address=248, function=3, start=0, count=1))
    assert codec_of("delta").encode(Request(address=254, function=3, start=0, count=1))[0] == 254


def test_a_scan_asks_those_of_the_standard():
    asked = [address for _, address in scan_plan(["modbus"], None)]
    assert asked == list(range(1, 248))
