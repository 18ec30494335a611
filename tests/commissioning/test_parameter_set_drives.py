"""Backup and restore with virtual drives: awaited, after a reset, on a bad line, and across makers."""

import asyncio
from dataclasses import replace
from random import Random

import pytest
from set_drives import Case, cases

import drivecomm
from drivecomm.bus import open_bus_async
from drivecomm.commissioning.parameter_sets import (
    RestoreOptions,
    back_up,
    back_up_async,
    carry_out_plan,
    carry_out_plan_async,
    compare,
    factory_set,
    factory_set_async,
    plan_restore,
    plan_restore_async,
)
from drivecomm.errors import NoReplyError, NotSupported
from drivecomm.plant import FaultPlan, Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualLine, VirtualPlant


def changed_drive(case, seed=1):
    virtual = case.new()
    case.change(virtual, Random(seed))
    return virtual


@pytest.mark.parametrize("case", cases(), ids=repr)
def test_no_command_or_communication_parameter_is_a_setting(case):
    words = {"control", "command", "station", "address", "baud", "parity", "node", "initialise", "tuning"}
    known = {
        "control_site", "control_word_source", "control_word_timeout_time", "control_word_timeout_function",
        "control_range", "speed_control", "maximum_control_deviation", "control_bit_4_meaning",
        "control_bits_11_12_meaning", "command_source",
    }  # fmt: skip
    named = {info.name for _, info in case.settings if words & set(info.name.split("_"))}
    assert named <= known


def test_awaited_backup_and_restore_give_the_same_result():
    case = Case("vabus", "agile")

    async def main():
        line = VirtualLine([changed_drive(case)])
        async with open_bus_async(line.port) as bus:
            drive = bus.drive("vabus", 1, model=case.model)
            saved = await back_up_async(drive)
            line.drives[0].poke("481", 1)
            plan = await plan_restore_async(drive, saved)
            assert [item.address for item in plan.to("write")] == ["481[1]", "481[2]", "481[3]", "481[4]"]
            done = await carry_out_plan_async(drive, plan)
            assert done.complete
            assert (await back_up_async(drive)).entries == saved.entries
            with pytest.raises(drivecomm.UsageError, match="no vabus drive reports its factory values"):
                await factory_set_async(drive)
        return saved

    saved = asyncio.run(main())
    with drivecomm.open_bus(VirtualLine([changed_drive(case)]).port) as bus:
        assert back_up(bus.drive("vabus", 1, model=case.model)).entries == saved.entries


def test_restore_undoes_a_factory_reset_by_the_drive():
    case = Case("fuji", "frenic")
    line = VirtualLine([changed_drive(case)])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        saved = back_up(drive)
        drive.write("H03", 1, store=True)
        assert not compare(saved, back_up(drive)).same
        assert carry_out_plan(drive, plan_restore(drive, saved)).complete
        assert compare(saved, back_up(drive)).same


def test_restore_undoes_a_factory_reset_at_power_on():
    planned = DriveConfig(name="pump", protocol="danfoss-fc", address=3, line="hall", options={"model": "fc102"})
    plant = VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=(planned,)))
    with drivecomm.open_bus(plant.lines["hall"].port) as bus:
        drive = bus.drive("danfoss-fc", 3, model="fc102")
        drive.write("3-41", 12, store=True)
        saved = back_up(drive)
        plant.power_off("pump")
        plant.power_on_as_new("pump")
        assert [each.address for each in compare(saved, back_up(drive)).differences] == ["3-41"]
        assert carry_out_plan(drive, plan_restore(drive, saved)).written == ("3-41",)
        plant.power_off("pump")
        plant.power_on("pump")
        assert compare(saved, back_up(drive)).same, "a restore is kept over power-off"


@pytest.mark.parametrize("protocol", ["vabus", "danfoss-fc", "fuji", "vlt3500"])
def test_backup_and_restore_work_on_a_bad_line(protocol):
    case = Case(protocol, {"vabus": "acu", "danfoss-fc": "fc300", "fuji": "g11s", "vlt3500": "vlt3000"}[protocol])
    virtual = changed_drive(case)
    held = case.held(virtual)
    line = VirtualLine([virtual], faults=FaultPlan(rate=0.03, seed=7))
    with drivecomm.open_bus(line.port, attempts=8) as bus:
        saved = back_up(case.drive(bus))
    assert not saved.not_read
    line = VirtualLine([case.new()], faults=FaultPlan(rate=0.03, seed=7))
    with drivecomm.open_bus(line.port, attempts=8) as bus:
        drive = case.drive(bus)
        done = carry_out_plan(drive, plan_restore(drive, saved))
    assert done.complete
    assert case.held(line.drives[0]) == held


def test_parameter_without_an_answer_is_listed_as_not_read():
    line = VirtualLine([drivecomm.virtual.virtual_drive("vabus", 1, silent_on=frozenset({11}))])
    line.drives[0].store._infos.pop(481)
    with drivecomm.open_bus(line.port) as bus:
        saved = back_up(bus.drive("vabus", 1, model="agile"))
        assert list(saved.not_read) == ["481[1]", "481[2]", "481[3]", "481[4]"]
        assert "did not answer" in saved.not_read["481[1]"]
        line.power_off(line.drives[0])
        with pytest.raises(NoReplyError):
            back_up(bus.drive("vabus", 1, model="agile"))


def test_motor_settings_are_carried_to_a_drive_of_another_maker():
    own = {"maximum_frequency": "419", "motor_rated_power": "376"}
    theirs = {"maximum_frequency": "4-14", "motor_rated_power": "1-20", "output_current": "16-14"}
    fc, vabus = Case("danfoss-fc", "fc102"), Case("vabus", "agile")
    line = VirtualLine([fc.new(), drivecomm.virtual.virtual_drive("vabus", 2)])
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 1, model=_mapping(fc.model, theirs))
        pump = bus.drive("vabus", 2, model=_mapping(vabus.model, own))
        fan.write("maximum_frequency", 60)
        fan.write("motor_rated_power", "5.5")
        saved = back_up(fan)
        found = compare(saved, back_up(pump))
        assert {each.address: (str(each.left), str(each.right)) for each in found.differences} == {
            "maximum_frequency": ("60.0 Hz", "50.00 Hz"),
            "motor_rated_power": ("5.50 kW", "4.0 kW"),
        }
        plan = plan_restore(pump, saved, RestoreOptions(another_drive=True))
        assert carry_out_plan(pump, plan).complete
        assert pump.read("376[3]").value == pump.read("motor_rated_power").value
        assert str(pump.read("motor_rated_power")) == "5.5 kW"
        pump.write("419[2]", 70, store=True)
        unclear = compare(saved, back_up(pump)).differences
        assert [(each.address, each.kind) for each in unclear] == [("maximum_frequency", "not comparable")]
        assert "419[2] is 70.00 Hz" in unclear[0].reason


def _mapping(model, quantities):
    return replace(model, quantities=quantities)


def test_factory_values_are_read_from_the_drive():
    case = Case("danfoss-fc", "fc102")
    line = VirtualLine([case.new()])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        drive.write("3-41", 12)
        factory = factory_set(drive)
        assert str(factory.entries["3-41"]) == "3.00 s"
        assert str(factory.entries["3-10[7]"]) == "0.00 %"
        assert "0-37" in factory.not_read, "of texts no description tells"
        assert "3-41" in [each.address for each in compare(back_up(drive), factory).differences]


def test_unwritable_texts_are_left_alone_with_the_reason():
    case = Case("danfoss-fc", "fc101")
    line = VirtualLine([case.new()])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        saved = back_up(drive)
        line.drives[0].poke("0-37", "FAN 2")
        line.drives[0].poke("3-41", 777)
        done = carry_out_plan(drive, plan_restore(drive, saved))
        assert done.written == ("3-41",)
        assert "reading texts only" in {item.address: item.reason for item in done.plan.to("skip")}["0-37"]


def test_volatile_restore_is_refused_if_every_write_is_stored():
    case = Case("vabus", "act")
    line = VirtualLine([case.new()])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        with pytest.raises(NotSupported, match="keeps every write over power-off"):
            plan_restore(drive, back_up(drive), RestoreOptions(volatile=True))
