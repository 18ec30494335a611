"""Registers read by masters: the same addresses for every drive, and only current values."""

import math
import struct
import time
from dataclasses import replace
from decimal import Decimal

import pytest
from fake_plant import value
from raw_master import Refused, until

from drivecomm.line import STATUS
from drivecomm.plant import Plant
from drivecomm.protocol import DriveState as Motion, DriveStatus
from drivecomm.server import CurrentValue

FREQUENCY, CURRENT, VOLTAGE = 8, 12, 16
GOOD, UNCERTAIN, WAITING, STALE, UNAVAILABLE, BAD = 192, 64, 32, 24, 4, 0


def status_value(drive="pump", *, quality="good"):
    return value(drive, STATUS, "0", "", quality=quality)


def give(plant, master, *values):
    """Publish values of the plant, and wait until the door has received them."""
    plant.change(*values)
    marker = value("fan", "480", f"{time.monotonic():.6f}")
    plant.change(marker)
    expected = struct.unpack(">f", struct.pack(">f", float(marker.reading.value)))[0]

    def came():
        try:
            return master.float(200, unit=2) == expected
        except Refused:
            return False

    until(came)


@pytest.fixture
def master(serve):
    with serve(registers={"fan": {"480": 200}})() as found:
        yield found


@pytest.mark.parametrize("function", [3, 4])
def test_value_has_its_quality_and_age(plant, master, function):
    give(plant, master, value("pump", "output_frequency", "49.95", time_s=time.time() - 1.2))
    assert master.float(FREQUENCY, function=function) == pytest.approx(49.95, abs=1e-5)
    quality, age = master.read(FREQUENCY + 2, 2, function=function)
    assert quality == GOOD
    assert 12 <= age < 60


def test_float_has_its_high_word_first(plant, master):
    give(plant, master, value("pump", "output_frequency", "50"))
    assert master.read(FREQUENCY, 2) == [0x4248, 0x0000]


def test_each_drive_has_the_same_addresses(plant, master):
    give(plant, master, value("pump", "output_frequency", "10"), value("fan", "output_frequency", "20"))
    assert [master.float(FREQUENCY, unit=unit) for unit in (1, 2)] == [10, 20]


def test_uncertain_value_has_quality_uncertain(plant, master):
    give(plant, master, value("pump", "output_frequency", "10", quality="uncertain"))
    assert master.read(FREQUENCY, 3)[2] == UNCERTAIN


def test_missing_value_in_a_block_is_nan(plant, master):
    give(plant, master, value("pump", "output_frequency", "10"), value("pump", "output_current", quality="stale"))
    words = master.read(FREQUENCY, 12)
    numbers = [struct.unpack(">f", struct.pack(">HH", *words[place : place + 2]))[0] for place in (0, 4, 8)]
    assert numbers[0] == 10
    assert math.isnan(numbers[1])
    assert math.isnan(numbers[2])
    assert [words[place] for place in (2, 6, 10)] == [GOOD, STALE, UNAVAILABLE]
    assert words[7] == words[11] == 65535


@pytest.mark.parametrize("quality", ["stale", "bad"])
def test_stale_or_bad_value_gives_exception_11(plant, master, quality):
    give(plant, master, value("pump", "output_frequency", quality=quality))
    for address, count in ((FREQUENCY, 2), (FREQUENCY, 4), (FREQUENCY, 112)):
        with pytest.raises(Refused) as caught:
            master.read(address, count)
        assert caught.value.code == 11


def test_expired_value_gives_exception_11(plant, master):
    """The door checks the age itself, in case the server hangs and reports no stale value."""
    old = value("pump", "output_frequency", "10", time_s=time.time() - 3.1)
    give(plant, master, replace(old, keeps_s=3.0))
    with pytest.raises(Refused) as caught:
        master.read(FREQUENCY, 2)
    assert caught.value.code == 11
    assert master.read(FREQUENCY + 2, 1) == [STALE]


def test_value_from_the_future_gives_exception_11(plant, master):
    give(plant, master, replace(value("pump", "output_frequency", "10", time_s=time.time() + 3600), keeps_s=3.0))
    with pytest.raises(Refused) as caught:
        master.read(FREQUENCY, 2)
    assert caught.value.code == 11


def test_value_not_read_yet_gives_exception_11(master):
    with pytest.raises(Refused) as caught:
        master.read(CURRENT, 2)
    assert caught.value.code == 11
    assert master.read(CURRENT + 2, 2) == [WAITING, 65535]


def test_value_that_is_not_polled_gives_exception_10(master):
    with pytest.raises(Refused) as caught:
        master.read(VOLTAGE, 2)
    assert caught.value.code == 10
    assert master.read(VOLTAGE + 2, 2) == [UNAVAILABLE, 65535]


@pytest.mark.parametrize("unit", [0, 3, 247, 248, 255])
def test_unknown_unit_gives_exception_10(master, unit):
    for content in (b"\x04\x00\x00\x00\x01", b"\x2b\x0e\x01\x00", b"\x10\x03\xe8\x00\x01\x02\x00\x01"):
        with pytest.raises(Refused) as caught:
            master.exchange(content, unit)
        assert caught.value.code == 10


def test_removed_drive_gives_exception_10(plant, master):
    plant.plant = Plant(lines=plant.plant.lines, drives=plant.plant.drives[1:], file="hall.toml")
    with pytest.raises(Refused) as caught:
        master.read(0, 120)
    assert caught.value.code == 10


@pytest.mark.parametrize(
    ("address", "count"),
    [
        (FREQUENCY, 1), (FREQUENCY + 1, 1), (FREQUENCY + 1, 4), (4, 5),
        (120, 1), (119, 2), (199, 1), (65535, 2), (65535, 1), (1000, 1), (204, 1),
    ],
)  # fmt: skip
def test_unknown_address_or_half_a_number_gives_exception_2(plant, master, address, count):
    give(plant, master, value("pump", "output_frequency", "10"))
    with pytest.raises(Refused) as caught:
        master.read(address, count)
    assert caught.value.code == 2


@pytest.mark.parametrize("count", [0, 126, 65535])
def test_invalid_register_count_gives_exception_3(master, count):
    with pytest.raises(Refused) as caught:
        master.read(0, count)
    assert caught.value.code == 3


@pytest.mark.parametrize(
    "content",
    [b"\x04", b"\x04\x00\x00\x00", b"\x04\x00\x00\x00\x01\x00", b"\x06\x03\xe8", b"\x10\x03\xe8\x00\x02\x02\x00\x00"],
    ids=["nothing", "too-short", "too-long", "short-write", "other-count"],
)
def test_request_of_wrong_length_gives_exception_3(serve, content):
    with serve(commands_from=["127.0.0.1"])() as master:
        with pytest.raises(Refused) as caught:
            master.exchange(content)
        assert caught.value.code == 3


@pytest.mark.parametrize("function", [1, 2, 5, 7, 8, 15, 17, 20, 22, 24, 43, 100])
def test_unsupported_function_gives_exception_1(master, function):
    with pytest.raises(Refused) as caught:
        master.exchange(bytes([function, 0, 0, 0, 1]))
    assert caught.value.code == 1


def test_state_word_shows_status_lease_and_warning(plant, master):
    status = DriveStatus(
        word=0x1F07, state=Motion.RUNNING, running=True, fault=False, warning=True, at_reference=True, reverse=True,
        remote=True,
    )  # fmt: skip
    plant.states["pump"] = replace(plant.states["pump"], status=status, kept="ramp", lease=object())
    give(plant, master, status_value())
    layout, state, raw, fault, quality, age = master.read(0, 6)
    assert layout == 1
    assert state == 0b1110_1101_1011
    assert (raw, fault, quality) == (0x1F07, 0, GOOD)
    assert age < 50


@pytest.mark.parametrize(("code", "told"), [(14, 14), (None, 65535), (70000, 65535)])
def test_fault_register_shows_the_active_fault(plant, master, code, told):
    status = DriveStatus(word=8, state=Motion.FAULT, running=False, fault=True, fault_code=code)
    plant.states["pump"] = replace(plant.states["pump"], status=status)
    give(plant, master, status_value())
    assert master.read(1, 3) == [0b10_0011, 8, told]


def test_silent_drive_gives_exception_11(plant, master):
    """Every read fails, of one register or of all, except a read of only the quality and age of a value."""
    plant.states["pump"] = replace(plant.states["pump"], status=None, reachability="silent")
    give(plant, master, status_value(quality="bad"), value("pump", "output_frequency", quality="bad"))
    for address, count in ((1, 1), (1, 3), (0, 8), (0, 120), (FREQUENCY, 2), (0, 6)):
        with pytest.raises(Refused) as caught:
            master.read(address, count)
        assert caught.value.code == 11
    assert master.read(4, 2) == [BAD, 65535]


def test_one_telegram_reads_all_common_registers(plant, master):
    give(plant, master, status_value(), value("pump", "output_frequency", "10"))
    assert len(master.read(0, 120)) == 120


def test_registers_declared_in_the_plant_file_are_readable(plant, serve):
    own = {"pump": {"480": 200, "output_current": {"address": 996, "type": "uint32"}}}
    with serve(registers={**own, "fan": {"480": 200}})() as master:
        give(plant, master, value("pump", "480", "30.5"), value("pump", "output_current", "70000"))
        assert master.float(200) == 30.5
        assert master.read(996, 3) == [1, 70000 - 65536, GOOD]
        for address in (204, 208, 992):
            with pytest.raises(Refused) as caught:
                master.read(address, 4)
            assert caught.value.code == 2


@pytest.mark.parametrize(
    ("number", "amount"),
    [("float32", "idle"), ("float32", 2**24 + 1), ("float32", Decimal("1e39")), ("uint32", Decimal("0.5")),
     ("uint32", -1), ("uint32", 2**32 - 1), ("uint32", "idle")],
)  # fmt: skip
def test_value_that_does_not_fit_its_register_gives_exception_10(plant, serve, number, amount):
    own = {"480": {"address": 200, "type": number}}
    with serve(registers={"pump": own, "fan": {"480": 200}})() as master:
        found = value("pump", "480")
        give(plant, master, replace(found, reading=replace(found.reading, value=amount)))
        assert master.read(202, 2) == [UNAVAILABLE, 65535]
        with pytest.raises(Refused) as caught:
            master.read(200, 2)
        assert caught.value.code == 10


def test_bit_word_is_an_integer(plant, serve):
    """A float32 would lose bits of the word."""
    with serve(registers={"fan": {"480": 200}})() as master:
        found = value("pump", "alarm_word")
        give(plant, master, replace(found, reading=replace(found.reading, value=0x80000001)))
        assert master.read(76, 3) == [0x8000, 1, GOOD]


def test_failed_poll_hides_the_earlier_value(plant, master):
    give(plant, master, value("pump", "output_frequency", "10"))
    assert master.float(FREQUENCY) == 10
    last = value("pump", "output_frequency", "10").reading
    failed = CurrentValue(drive="pump", name="output_frequency", reading=last, quality="stale", time_s=time.time())
    give(plant, master, failed)
    with pytest.raises(Refused) as caught:
        master.read(FREQUENCY, 2)
    assert caught.value.code == 11
