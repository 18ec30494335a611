"""Modbus addresses beyond 247, the limit of the standard, for drives whose model allows them."""

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
def test_drive_may_have_the_highest_address_of_its_model(model, highest):
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
def test_address_above_247_is_refused_for_other_drives(model):
    line = VirtualLine([virtual_drive("modbus", 247, model="gs2")])
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("modbus", 247, model=model)
        with pytest.raises(AddressError, match="addresses are 1 to 247"):
            bus.drive("modbus", 248, model=model)
    with pytest.raises(AddressError, match="1 to 247"):
        virtual_drive("modbus", 248, model="gs2")


def test_option_highest_address_allows_up_to_255():
    line = VirtualLine([virtual_drive("modbus", 255, model="gs2", highest_address=255)])
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive("modbus", 255, model="gs2", highest_address=255).read("output_frequency").value == 0
        for beyond in (0, 256):
            with pytest.raises(UsageError, match=f"highest_address of {beyond} is not 1 to 255"):
                bus.drive("modbus", 1, highest_address=beyond)


@pytest.mark.parametrize("direction", ["request", "reply"])
def test_codec_accepts_addresses_up_to_the_limit_of_the_model(direction):
    data = bytes.fromhex("F8 06 00 00 00 00")
    data += crc16(data)
    with pytest.raises(TelegramError) as caught:
        codec_of().decode(data, direction)
    assert (caught.value.category, caught.value.field) == ("field", "address")
    assert codec_of("delta").decode(data, direction).address == 248
    with pytest.raises(TelegramError):
        codec_of().encode(Request(address=248, function=3, start=0, count=1))
    assert codec_of("delta").encode(Request(address=254, function=3, start=0, count=1))[0] == 254


def test_scan_probes_addresses_1_to_247():
    asked = [address for _, address in scan_plan(["modbus"], None)]
    assert asked == list(range(1, 248))
