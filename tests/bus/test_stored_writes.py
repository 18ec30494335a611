"""The guard of EEPROM cells counts stored writes per parameter, in any spelling, and per drive."""

import pytest
from hypothesis import given, settings, strategies as st
from two_faces import each_face, open_on

import drivecomm
from drivecomm.bus import ALLOWED, StoredWrites
from drivecomm.errors import UsageError
from drivecomm.virtual import VirtualLine, virtual_drive

SPELLINGS = {
    "danfoss-fc": ["3-03", "303", "03-03", "0303", "maximum_reference", "3-03[0]"],
    "vabus": ["419", "0419", "419[0]", "maximum_frequency"],
    "fuji": ["F07", "acceleration_time", "acceleration_time_1"],
}
MODELS = {"danfoss-fc": "fc300", "vabus": "agile", "fuji": "frenic"}


def one(protocol, model):
    virtual = virtual_drive(protocol, 1, model=model)
    return virtual, drivecomm.open_bus(VirtualLine([virtual]).port)


@pytest.mark.parametrize("protocol", SPELLINGS)
def test_all_spellings_count_as_one_parameter(protocol):
    _, bus = one(protocol, model=MODELS[protocol])
    with bus:
        drive = bus.drive(protocol, 1, model=MODELS[protocol])
        for number in range(ALLOWED):
            drive.write(SPELLINGS[protocol][number % len(SPELLINGS[protocol])], 10 + number, store=True)
        sent = bus.counters[f"{protocol}:1"]["requests"]
        for spelling in SPELLINGS[protocol]:
            with pytest.raises(UsageError, match="EEPROM cells wear out"):
                drive.write(spelling, 10, store=True)
            with pytest.raises(UsageError, match="EEPROM cells wear out"):
                drive.write_and_read(spelling, 10, store=True)
        assert bus.counters[f"{protocol}:1"]["requests"] == sent


def test_writes_with_and_without_a_model_count_as_one_parameter():
    _, bus = one("danfoss-fc", model="fc300")
    with bus:
        known, plain = bus.drive("danfoss-fc", 1, model="fc300"), bus.drive("danfoss-fc", 1)
        for number in range(ALLOWED // 2):
            known.write("maximum_reference", 40 + number, store=True)
            plain.write("3-03", 40_000 + number, store=True, type="int32")
        for drive in (known, plain):
            with pytest.raises(UsageError, match="303 of danfoss-fc:1 was stored 10 times"):
                drive.write("0303", 50, store=True, type="int32")


def test_each_element_of_a_parameter_is_counted_separately():
    _, bus = one("danfoss-fc", model="fc300")
    with bus:
        drive = bus.drive("danfoss-fc", 1, model="fc300")
        for number in range(ALLOWED):
            drive.write("3-10", number, store=True, index=2)
        for spelled, options in (("3-10[2]", {}), ("310[2]", {}), ("preset_reference", {"index": 2})):
            with pytest.raises(UsageError, match=r"310\[2\] of danfoss-fc:1 was stored 10 times"):
                drive.write(spelled, 5, store=True, **options)
        drive.write("3-10[3]", 5, store=True)
        drive.write("3-10", 5, store=True)


@each_face
def test_broadcast_write_counts_for_each_drive(face):
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("vabus", 2)])
    with open_on(face, line.port) as bus:
        everyone, first, second = bus.broadcast("vabus"), bus.drive("vabus", 1), bus.drive("vabus", 2)
        for number in range(4):
            first.write("480", number, store=True, type="long")
        for number in range(6):
            everyone.write("480", number, store=True, type="long")
        with pytest.raises(UsageError, match="480 of vabus:1 was stored 10 times"):
            first.write("480", 3, store=True, type="long")
        with pytest.raises(UsageError, match=r"480 of vabus:\* was stored 10 times"):
            everyone.write("0480", 3, store=True, type="long")
        second.write("480", 3, store=True, type="long")
        everyone.write("480", 3, type="long")


@given(st.lists(st.tuples(st.sampled_from(["a:1", "a:2", "a:*", "b:1"]), st.floats(0, 600)), max_size=60))
@settings(deadline=None)
def test_no_drive_stores_more_than_allowed_within_an_hour(calls):
    guard, done, now = StoredWrites(3), [], 0.0
    for who, later in calls:
        now += later
        try:
            guard.count(who, "480", now)
        except UsageError:
            continue
        done.append((who, now))
    for drive in ("a:1", "a:2", "b:1"):
        times = [at for who, at in done if who in (drive, f"{drive[0]}:*")]
        assert all(sum(0 <= at - start < 3600 for at in times) <= 3 for start in times)
