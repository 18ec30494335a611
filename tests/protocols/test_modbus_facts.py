"""Facts of single Modbus series, as their virtual drives show them: coils, refusals, counters, data sets."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import NotSupported, RefusedError, ValueRefusedError
from drivecomm.protocol import Damaged, Framed, Framer, Motor, Stop
from drivecomm.protocol.schema import crc16
from drivecomm.virtual import VirtualLine, virtual_drive


def told(drive, request, now=1.0):
    """Pass a telegram without its CRC to a drive; return the reply, also without it, or None for silence."""
    data = bytes.fromhex(request)
    data += crc16(data)
    reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), now)
    return reply and reply.data[:-2].hex(" ").upper()


def drive_of(model):
    return virtual_drive("modbus", 1, model=model)


@pytest.mark.parametrize(
    ("model", "request_", "answer"),
    [
        # Danfoss: register 7, 9 and the array index; 32 bits, the high word first; coil 34 is bit 1 of the status word
        ("danfoss-fc", "01 03 00 06 00 01", "01 03 02 00 00"),
        ("danfoss-fc", "01 10 00 08 00 01 02 00 03", "01 10 00 08 00 01"),
        ("danfoss-fc", "01 01 00 20 00 10", "01 01 02 07 02"),
        ("danfoss-fc", "01 0B", "01 0B 00 00 00 00"),
        ("danfoss-fc", "01 11", "01 11 02 01 FF"),
        ("danfoss-fc", "01 08 00 00 12 34", "01 88 01"),
        ("danfoss-fc", "01 08 00 02 00 00", "01 08 00 02 00 00"),
        ("danfoss-fc", "01 05 00 20 FF 00", "01 85 02"),
        ("danfoss-fc", "01 01 00 42 00 01", "01 81 02"),
        # ABB: the telegram that masters use; a write to a read-only register is refused with 3
        ("abb-acs355", "01 03 00 00 00 0C", "01 03 18 " + "00 " * 6 + "02 40 " + "00 " * 15 + "00"),
        ("abb-acs355", "01 06 00 03 00 00", "01 86 03"),
        ("abb-acs355", "01 03 00 0C 00 01", "01 83 02"),
        ("abb-acs355", "01 01 00 00 00 01", "01 81 01"),
        ("abb-acs580", "01 03 01 01 00 01", "01 83 02"),
        ("abb-acs580", "01 06 00 01 27 10", "01 06 00 01 27 10"),
        # Fuji: after an existing code, unused codes read as 0; writes to them are ignored
        ("fuji-frenic", "01 03 08 15 00 04", "01 03 08 02 36 00 00 12 11 00 12"),
        ("fuji-frenic", "01 03 08 62 00 01", "01 83 02"),
        ("fuji-frenic", "01 03 08 16 00 01", "01 83 02"),
        ("fuji-frenic", "01 03 77 77 00 01", "01 83 02"),
        ("fuji-frenic", "01 06 08 09 00 00", "01 86 07"),
        ("fuji-frenic", "01 08 00 01 00 00", "01 88 02"),
        ("fuji-frenic", "01 08 00 00 12 34", "01 08 00 00 12 34"),
        ("fuji-frenic", "01 17 08 09 00 01 07 05 00 01 02 00 00", "01 97 01"),
        ("fuji-frenic", "01 04 08 09 00 01", "01 84 01"),
        ("fuji-frenic", "01 01 00 50 00 01", "01 81 02"),
        # Vacon: ID 2101 to 2104, which function 04 reads as well
        ("vacon10", "01 04 08 34 00 04", "01 04 08 00 01 00 01 00 00 00 00"),
        # Yaskawa: the printed telegram, and two refusals that show the limits
        ("yaskawa", "01 03 00 20 00 04", "01 03 08 00 04 00 00 00 00 00 00"),
        ("yaskawa", "01 03 00 20 00 11", "01 83 03"),
        ("yaskawa", "01 08 00 00 A5 37", "01 08 00 00 A5 37"),
        ("yaskawa", "01 08 00 01 00 00", "01 88 01"),
        # Delta: the telegram of common masters
        ("delta", "01 03 21 00 00 04", "01 03 08 00 00 04 00 00 00 00 00"),
        # Bonfiglioli: one parameter per request, 32-bit values also by function 03 (ACU manual p. 28, 44)
        ("bonfiglioli", "01 03 01 74 00 02", "01 83 04"),
        ("bonfiglioli", "01 03 01 74 00 01", "01 03 02 05 AA"),
        ("bonfiglioli", "01 03 01 E1 00 02", "01 03 04 00 00 03 E8"),
        ("bonfiglioli", "01 03 01 E1 00 01", "01 83 04"),
        ("bonfiglioli", "01 64 01 E1", "01 64 00 00 03 E8"),
        # V20 and G120: a read beyond the registers is refused with 2, a write to a read-only one with 4
        ("siemens-v20", "01 06 00 17 00 01", "01 86 04"),
        ("siemens-g120", "01 06 00 6D 00 01", "01 86 04"),
        ("siemens-v20", "01 01 00 00 00 01", "01 81 01"),
        # ATV212: the printed examples of S1A53844 p. 33
        ("schneider-atv212", "01 03 FD 00 00 02", "01 83 03"),
        # Optidrive: Plus has functions 03 and 06 only
        ("optidrive-plus", "01 10 00 00 00 01 02 00 01", "01 90 01"),
        ("optidrive-e3", "01 10 00 00 00 01 02 00 00", "01 10 00 00 00 01"),
    ],
)
def test_request_gets_the_documented_reply(model, request_, answer):
    assert told(drive_of(model), request_) == answer.strip()


def test_danfoss_drive_is_commanded_by_coils():
    drive = drive_of("danfoss-fc")
    # REF 4000H and CTW 047C as coils, the lowest bit in the first coil
    assert told(drive, "01 0F 00 10 00 10 02 00 40") == "01 0F 00 10 00 10"
    assert told(drive, "01 0F 00 00 00 10 02 7C 04") == "01 0F 00 00 00 10"
    drive.follow(60.0)
    assert drive.motor.output_hz == drive.motor.maximum_hz
    assert told(drive, "01 03 C3 4F 00 01", 60.0) == "01 03 02 04 7C"
    assert told(drive, "01 03 C4 21 00 01", 60.0) == "01 03 02 40 00"
    assert told(drive, "01 01 00 30 00 10", 60.0) == "01 01 02 00 40"
    # coil 7 alone is bit 6: 0 is a ramp stop
    told(drive, "01 05 00 06 00 00", 60.0)
    drive.follow(120.0)
    assert not drive.motor.running


def test_coil_65_of_a_danfoss_drive_selects_the_storage_of_a_write():
    virtual = drive_of("danfoss-fc")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("modbus", 1, model="danfoss-fc")
        before = drive.read("3410").value
        for store, coil, left in ((False, 0, before), (True, 1, before + 1)):
            drive.write("3410", before + 1, store=store)
            assert virtual.peek("c65", 0.0) == coil
            virtual.power_cycle(1.0)
            assert drive.read("3410").value == left


def test_danfoss_drive_counts_its_telegrams():
    drive = drive_of("danfoss-fc")
    framer = Framer(drive.codec, "request")
    finds = [*framer.feed(bytes.fromhex("01 03 C3 4F 00 01 00 00")), *framer.flush()]
    assert drive.hear(next(find for find in finds if isinstance(find, Damaged)), 1.0) is None
    for request in ("01 03 C3 4F 00 01", "02 03 C3 4F 00 01", "01 03 00 50 00 01", "01 03 C3 4F 00 01"):
        told(drive, request)
    for number, count in ((11, 5), (13, 1), (14, 6), (12, 1)):
        assert told(drive, f"01 08 00 {number:02X} 00 00") == f"01 08 00 {number:02X} 00 {count:02X}", number
    assert told(drive, "01 0B") == "01 0B 00 00 00 06"
    assert told(drive, "01 08 00 0A 00 00") == "01 08 00 0A 00 00"
    assert told(drive, "01 08 00 0D 00 00") == "01 08 00 0D 00 00"


@pytest.mark.parametrize(
    ("request_", "runs"),
    [
        ("00 10 00 01 00 01 02 00 01", True),
        ("00 10 00 01 00 03 06 00 01 13 88 00 64", False),
        ("00 10 00 03 00 01 02 00 64", False),
    ],
)
def test_yaskawa_drive_accepts_broadcasts_to_two_registers_only(request_, runs):
    drive = drive_of("yaskawa")
    drive.poke("0x0003", 200)
    assert told(drive, request_) is None
    assert drive.motor.running is runs
    assert drive.peek("0x0003", 1.0) == 200


def test_bonfiglioli_parameter_has_four_data_sets():
    virtual = drive_of("bonfiglioli")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("modbus", 1, model="bonfiglioli")
        drive.write("481", "12.5", store=True)
        sets = [f"fixed_frequency_2_set_{number}" for number in (1, 2, 3, 4)]
        assert [drive.read(each).value for each in sets] == [Decimal("12.50")] * 4
        drive.write(sets[2], "20", store=True)
        assert [drive.read(each).value for each in (*sets, "481")] == [
            Decimal(each) for each in ("12.5", "12.5", "20", "12.5", "12.5")
        ]
        drive.write(sets[1], "30")
        assert drive.read(sets[1]).value == 30
        # The volatile write went to data set 7, the RAM side of set 2.
        virtual.power_cycle(1.0)
        assert drive.read(sets[1]).value == Decimal("12.5")


def test_v20_obeys_both_sets_of_registers():
    drive = drive_of("siemens-v20")
    for request in ("01 06 00 64 20 00", "01 06 00 63 04 7E", "01 06 00 63 04 7F"):
        assert told(drive, request) == request
    drive.follow(60.0)
    assert drive.motor.output_hz == pytest.approx(drive.motor.maximum_hz / 2)
    assert told(drive, "01 03 00 6E 00 01", 60.0) == "01 03 02 20 00"
    assert told(drive, "01 03 00 05 00 01", 60.0) == "01 03 02 00 01"
    assert drive.peek("40342", 60.0) == drive.peek("40024", 60.0) != 0
    told(drive, "01 06 00 63 0C 7F", 60.0)
    drive.follow(120.0)
    assert drive.motor.output_hz < 0
    told(drive, "01 06 00 63 04 7E", 120.0)
    drive.follow(180.0)
    assert not drive.motor.running


@pytest.mark.parametrize("how", [Stop.RAMP, Stop.COAST, Stop.QUICK])
@pytest.mark.parametrize(
    ("model", "telegrams"),
    [
        ("siemens-g120", ["01 06 00 63 04 7E", "01 06 00 63 0C 7F"]),
        ("abb-acs580", [f"01 10 00 00 00 01 02 04 {word}" for word in ("06", "07", "0F", "3F", "7F")]),
    ],
)
def test_g120_and_acs580_start_stop_and_reset(model, telegrams, how):
    sent = []
    virtual = drive_of(model)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model=model)
        drive.status()
        drive.set_reference(percent=50)
        sent.clear()
        drive.start(reverse=model == "siemens-g120")
        writes = [each.data[:-2].hex(" ").upper() for each in sent if each.what == "sent" and each.data[1] in (6, 16)]
        assert writes == telegrams
        line.advance(30)
        status = drive.status()
        assert (status.running, status.at_reference, status.fault) == (True, True, False)
        drive.stop(how)
        line.advance(60)
        assert not drive.status().running
        virtual.trip(1, line.time)
        assert drive.status().fault
        drive.reset()
        assert not drive.status().fault
        assert not virtual.motor.running


@pytest.mark.parametrize(
    ("seconds", "word"), [("6", 600), ("9.99", 999), ("20", 0x4C8), ("99.9", 0x7E7), ("250", 0x8FA), ("3600", 0xD68)]
)
def test_fuji_ramp_time_has_three_digits_and_an_exponent(seconds, word):
    virtual = drive_of("fuji-frenic")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("modbus", 1, model="fuji-frenic")
        assert drive.read("0x0007").value == 6
        drive.write("0x0007", seconds, store=True)
        assert virtual.peek("0x0007", 0.0) == word
        assert drive.read("0x0007").value == Decimal(seconds)
        for strange in ("12.34", "100.5"):
            with pytest.raises(ValueRefusedError, match="three digits"):
                drive.write("0x0007", strange, store=True)


def test_coast_of_an_optidrive_plus_is_refused():
    with drivecomm.open_bus(VirtualLine([drive_of("optidrive-plus")]).port) as bus, pytest.raises(NotSupported):
        bus.drive("modbus", 1, model="optidrive-plus").stop(Stop.COAST)


@pytest.mark.parametrize(
    ("model", "voltage", "dc_link"), [("delta-vfd-b", "0x2106", "0x2105"), ("delta-vfd-e", "0x2109", "0x2108")]
)
def test_older_delta_drives_have_their_own_voltage_registers(model, voltage, dc_link):
    with drivecomm.open_bus(VirtualLine([drive_of(model)]).port) as bus:
        drive = bus.drive("modbus", 1, model=model)
        assert [drive.read(each).parameter for each in ("output_voltage", "dc_link_voltage")] == [voltage, dc_link]


def test_goodrive_volatile_write_uses_another_address():
    sent = []
    with drivecomm.open_bus(VirtualLine([drive_of("invt")]).port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model="invt", confirmed="invt")
        drive.status()
        sent.clear()
        for store in (False, True):
            with pytest.raises(RefusedError, match="unknown address"):
                drive.write("0x0007", 5, store=store)
        drive.set_reference(hz=10)
    told = [each.data[:-2].hex(" ").upper() for each in sent if each.what == "sent"]
    assert told == ["01 06 80 07 00 05", "01 06 00 07 00 05", "01 06 20 01 03 E8"]


@pytest.mark.parametrize(("decimals", "shown"), [(2, "12.34 A"), (1, "123.4 A"), (0, "1234 A")])
def test_decimals_of_a_delta_current_come_from_another_register(decimals, shown, monkeypatch):
    virtual = drive_of("delta")
    virtual.poke("0x211F.high", decimals)
    monkeypatch.setattr(Motor, "measured", lambda _, name: 12.34 if name == "output_current" else None)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("modbus", 1, model="delta")
        wanted = ["0x2103", "output_current", "0x2105"]
        assert [len(block) for block in drive.blocks(wanted)] == [1, 1, 1]
        assert str(drive.read("output_current")) == shown
        assert [str(each) for each in drive.read_many(wanted)][1] == shown


def test_signed_registers_are_read_as_s16():
    for model, address in (
        ("vacon10", "2104"),
        ("vacon10", "2107"),
        ("siemens-v20", "40024"),
        ("siemens-v20", "40025"),
    ):
        virtual = drive_of(model)
        with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
            assert bus.drive("modbus", 1, model=model).read(address).type == "s16"
