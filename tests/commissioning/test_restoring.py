"""Restores: order of writes, early refusals, values that change by themselves, and values that are never written."""

from dataclasses import replace
from decimal import Decimal
from random import Random
from types import SimpleNamespace

import pytest
from set_drives import cases_with_settings, cases_without_status

import drivecomm
from drivecomm.commissioning.parameter_sets import (
    ParameterEntry,
    ParameterSet,
    RestoreOptions,
    back_up,
    carry_out_plan,
    plan_restore,
)
from drivecomm.errors import (
    NoReplyError,
    NotSupported,
    ReadOnlyError,
    RefusedError,
    StateError,
    UsageError,
    ValueRefusedError,
    WrongDriveError,
)
from drivecomm.protocol import Model, ParameterInfo, Reading
from drivecomm.virtual import VirtualLine, virtual_drive

INFOS = [
    ("101", "profile", "", {}),
    ("102", "minimum_frequency", "Hz", {}),
    ("103", "maximum_frequency", "Hz", {}),
    ("104", "fixed_frequency", "Hz", {}),
    ("105", "rated_power", "kW", {}),
    ("106", "baud_rate", "", {"kind": "communication"}),
    ("107", "reset", "", {"kind": "command"}),
    ("108", "output_current", "A", {"access": "r"}),
    ("109", "bus_reference", "%", {"storage": "volatile"}),
    ("110", "password", "", {"access": "w"}),
    ("100", "data_lock", "", {}),
]
MODEL = Model(
    protocol="vabus",
    name="own",
    title="",
    source="",
    parameters={
        address: ParameterInfo(address=address, name=name, title=name, type="int", unit=unit, **extra)
        for address, name, unit, extra in INFOS
    },
    faults={},
    options={},
    quantities={"minimum_frequency": "102", "maximum_frequency": "103", "motor_rated_power": "105"},
)


class FakeDrive:
    """Fake drive whose maximum is never below its minimum and whose fixed frequency stays between them."""

    name = "vabus:1"
    model = MODEL
    in_ram_only = frozenset()
    capabilities = SimpleNamespace(stored_writes=True, volatile_writes=False)

    def __init__(self, **held):
        self.held = {
            "100": 0,
            "101": 0,
            "102": 0,
            "103": 50,
            "104": 10,
            "105": 4,
            "106": 4,
            "107": 0,
            "108": 1,
            "109": 0,
        }
        self.held |= {address.strip("_"): value for address, value in held.items()}
        self.writes = []
        self.identity = {"serial number": "1"}
        self.running = False
        self.effects = {}

    def read(self, parameter):
        address = MODEL.quantities.get(parameter, parameter)
        info = MODEL.parameters[address]
        return Reading(
            parameter=address, name=info.name, value=self.held[address], raw=self.held[address], unit=info.unit
        )

    def write(self, parameter, value, *, store):
        assert store
        self.writes.append(parameter)
        address = MODEL.quantities.get(parameter, parameter)
        after = {**self.held, address: value}
        if self.held["100"] and address != "100":
            raise RefusedError(address, 4, "locked")
        if not after["102"] <= after["104"] <= after["103"]:
            raise RefusedError(address, 1, "value not permitted")
        self.held = after
        self.effects.get(address, lambda _: None)(value)

    def check_write(self, _parameter, value, *, store):
        assert store
        if not isinstance(value, int | Decimal) or value > 1000:
            raise ValueRefusedError(f"{value} is outside 0 to 1000")

    def status(self):
        return SimpleNamespace(running=self.running)

    def identify(self):
        return self.identity


def a_set(**values):
    saved = back_up(FakeDrive())
    entries = dict(saved.entries)
    for key, value in values.items():
        address = key.strip("_")
        entries[address] = ParameterEntry(
            address=address, value=value, name=entries[address].name, unit=entries[address].unit
        )
    return ParameterSet(
        protocol="vabus", drive="vabus:1", model="own", entries=entries, identity={"serial number": "1"}
    )


def restore(drive, known, **options):
    return carry_out_plan(drive, plan_restore(drive, known, RestoreOptions(**options)))


def test_backup_holds_all_restorable_values():
    saved = back_up(FakeDrive())
    assert list(saved.entries) == ["100", "101", "102", "103", "104", "105", "106"]
    assert saved.not_read == {"110": "it can only be written"}
    assert {entry.common for entry in saved.entries.values()} == {
        "", "minimum_frequency", "maximum_frequency", "motor_rated_power",
    }  # fmt: skip
    assert list(back_up(FakeDrive(), ["measured"]).entries) == ["108", "109"]


def test_values_that_others_depend_on_are_written_first():
    drive = FakeDrive()
    restore(drive, a_set(_101=1, _102=5, _103=60, _104=55, _105=7))
    assert drive.writes == ["101", "105", "102", "103", "104"]


def test_data_lock_is_closed_last_and_opened_before_other_writes():
    drive = FakeDrive()
    assert restore(drive, a_set(_100=1, _101=1, _104=20)).complete
    assert drive.writes == ["101", "104", "100"]
    assert restore(drive, a_set(_100=0, _101=2, _104=30)).complete
    assert (drive.held["100"], drive.held["101"], drive.held["104"]) == (0, 2, 30)


def test_limits_that_block_each_other_are_restored():
    drive = FakeDrive()
    done = restore(drive, a_set(_102=60, _103=100, _104=80))
    assert done.complete
    assert (drive.held["102"], drive.held["103"], drive.held["104"]) == (60, 100, 80)
    down = restore(drive, a_set(_102=0, _103=20, _104=10))
    assert down.complete
    assert (drive.held["102"], drive.held["103"], drive.held["104"]) == (0, 20, 10)


def test_value_changed_by_a_later_write_is_written_again():
    drive = FakeDrive()
    drive.effects["104"] = lambda _: drive.held.update({"101": 0})
    done = restore(drive, a_set(_101=1, _104=20))
    assert done.complete
    assert drive.writes == ["101", "104", "101"]
    assert done.written == ("101", "104")


def test_value_that_never_holds_is_reported_after_two_writes():
    drive = FakeDrive()
    drive.effects["101"] = lambda _: drive.held.update({"101": 0})
    done = restore(drive, a_set(_101=1, _104=20))
    assert not done.complete
    assert done.refused == {"101": "1 was written, and it is 0"}
    assert drive.writes.count("101") == 2, "once more, since another one was written in between"


def test_values_that_change_each_other_end_the_restore():
    drive = FakeDrive()
    drive.effects["101"] = lambda _: drive.held.update({"105": 0})
    drive.effects["105"] = lambda _: drive.held.update({"101": 0})
    done = restore(drive, a_set(_101=1, _105=7))
    assert not done.complete
    assert len(drive.writes) < 20


def test_refused_value_is_reported_with_the_reason_of_the_drive():
    drive = FakeDrive()
    done = restore(drive, a_set(_104=99))
    assert list(done.refused) == ["104"]
    assert "value not permitted" in done.refused["104"]
    assert drive.held["104"] == 10


def test_equal_values_are_not_written():
    drive = FakeDrive()
    assert restore(drive, a_set()).complete
    assert drive.writes == []


def test_values_left_alone_are_listed_with_the_reason():
    known = a_set(_106=1)
    extra = {
        "999": ParameterEntry(address="999", value=1),
        "104": ParameterEntry(address="104", value=1, name="another", unit="Hz"),
    }
    extra |= {"107": ParameterEntry(address="107", value=1), "108": ParameterEntry(address="108", value=1, unit="A")}
    extra |= {"109": ParameterEntry(address="109", value=1, unit="%"), "103": ParameterEntry(address="103", value=20)}
    known = ParameterSet(protocol="vabus", drive="vabus:1", model="own", entries={**known.entries, **extra})
    drive = FakeDrive()
    plan = plan_restore(drive, known)
    assert {item.address: item.reason.partition(" (")[0] for item in plan.to("skip")} == {
        "103": "unit: a number without unit cannot be given in Hz",
        "104": "it is another in the set and fixed_frequency on this drive",
        "106": "communication settings are only written with --communication",
        "107": "writing it is a command",
        "108": "it can only be read",
        "109": "it is lost at power-off",
        "999": "model own has no such parameter",
    }
    carry_out_plan(drive, plan)
    assert drive.writes == []


def test_communication_settings_are_written_last_and_only_on_request():
    drive = FakeDrive()
    assert restore(drive, a_set(_106=1, _104=20)).written == ("104",)
    assert restore(drive, a_set(_106=2, _104=21), communication=True).written == ("104", "106")


def test_communication_setting_that_silences_the_drive_is_unconfirmed():
    drive = FakeDrive()

    def gone(*_):
        drive.read = gone
        raise NoReplyError("vabus:1 did not answer")

    drive.effects["106"] = gone
    done = restore(drive, a_set(_106=1, _104=20), communication=True)
    assert (done.written, done.unconfirmed, done.complete) == (("104",), ("106",), False)


def test_unconfirmed_write_is_verified_by_reading():
    drive = FakeDrive()

    def silent(_):
        drive.effects.clear()
        raise NoReplyError("vabus:1 did not answer")

    drive.effects["104"] = silent
    assert restore(drive, a_set(_104=20)).written == ("104",)
    assert drive.writes == ["104"], "it had arrived"


def test_lost_write_is_repeated():
    drive = FakeDrive()

    def lost(_):
        drive.effects.clear()
        drive.held["104"] = 10
        raise NoReplyError("vabus:1 did not answer")

    drive.effects["104"] = lost
    assert restore(drive, a_set(_104=20)).written == ("104",)
    assert drive.writes == ["104", "104"]


def test_value_that_cannot_be_read_back_does_not_count_as_restored():
    drive = FakeDrive()

    def hide(_):
        def read(parameter):
            if parameter == "104":
                raise RefusedError("104", 5, "not readable")
            return FakeDrive.read(drive, parameter)

        drive.read = read

    drive.effects["104"] = hide
    done = restore(drive, a_set(_104=20))
    assert (done.written, done.complete) == ((), False)
    assert "cannot be read back" in done.refused["104"]


def test_refused_value_that_holds_in_the_end_counts_as_restored():
    drive = FakeDrive()
    drive.effects["100"] = lambda _: drive.held.update({"104": 99})
    done = restore(drive, a_set(_104=99, _100=1))
    assert (done.written, done.refused, done.complete) == (("100",), {}, True)


def test_invalid_value_prevents_all_writes():
    drive = FakeDrive()
    with pytest.raises(
        ValueRefusedError, match="103 maximum_frequency: 5000 is outside 0 to 1000; nothing was written"
    ):
        restore(drive, a_set(_101=1, _103=5000))
    assert drive.writes == []


def test_invalid_value_that_the_drive_holds_already_is_accepted():
    drive = FakeDrive(_103=5000)
    assert restore(drive, a_set(_103=5000, _101=1)).written == ("101",)


def test_restore_is_refused_while_the_motor_runs():
    drive = FakeDrive()
    drive.running = True
    with pytest.raises(StateError, match="the motor runs"):
        restore(drive, a_set(_101=1))
    assert drive.writes == []


def test_set_of_another_drive_is_refused_unless_allowed():
    drive = FakeDrive()
    drive.identity = {"serial number": "2", "software version": "9"}
    with pytest.raises(UsageError, match="its serial number is '1', and '2' on this drive; nothing was written"):
        restore(drive, a_set(_101=1))
    assert drive.writes == []
    assert restore(drive, a_set(_101=1), another_drive=True).written == ("101",)


def test_other_software_version_counts_as_the_same_drive():
    drive = FakeDrive()
    drive.identity = {"serial number": "1", "software version": "9"}
    known = a_set(_101=1)
    assert restore(drive, known).complete


def test_set_of_another_maker_is_carried_by_common_names():
    entries = [
        ParameterEntry(address="F03", value=60_000, unit="mHz", name="maximum", common="maximum_frequency"),
        ParameterEntry(address="F15", value=30, unit="Hz", name="minimum", common="minimum_frequency"),
        ParameterEntry(address="P02", value=5500, unit="W", name="power", common="motor_rated_power"),
        ParameterEntry(address="y01", value=7, name="station", common="bus_address", part="communication"),
        ParameterEntry(address="E01", value=7, name="terminal"),
    ]
    known = ParameterSet(
        protocol="fuji", drive="fuji:3", model="frenic", entries={entry.address: entry for entry in entries}
    )
    drive = FakeDrive(_104=40)
    with pytest.raises(UsageError, match="it is of a fuji drive, and vabus:1 is not one"):
        restore(drive, known)
    done = restore(drive, known, another_drive=True)
    assert done.complete
    assert (drive.held["102"], drive.held["105"]) == (30, Decimal("5.5"))
    assert drive.held["103"] == 50, "nobody knows what a mHz is here"
    assert {item.address: item.reason for item in done.plan.to("skip")} == {
        "maximum_frequency": "mHz cannot be given in Hz",
        "bus_address": "model own does not map it",
        "E01": "it has no common name",
    }


def test_volatile_restore_is_refused_if_every_write_is_stored():
    with pytest.raises(UsageError, match="keeps every write over power-off"):
        plan_restore(FakeDrive(), a_set(), RestoreOptions(volatile=True))


def test_backup_without_a_model_is_refused():
    drive = FakeDrive()
    drive.model = None
    with pytest.raises(UsageError, match="its parameters are not known without a model"):
        back_up(drive)


@pytest.mark.parametrize("case", cases_with_settings(), ids=repr)
def test_backup_restores_its_own_drive_completely(case):
    """This includes inverters of unknown rating, whose currents have an unknown scale."""
    virtual = case.type.new() if case.plugin.name != "fuji" else virtual_drive("fuji", 1, model=case.model)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive(case.plugin.name, case.address, model=case.model, confirmed=case.model.name)
        saved = back_up(drive)
        before = case.held(virtual)
        assert case.change(virtual, Random(3))
        plan = plan_restore(drive, saved)
        assert plan.missed == []
        assert carry_out_plan(drive, plan).complete
    writable = {address for address, info in case.settings if "w" in info.access}
    assert {address: raw for address, raw in case.held(virtual).items() if address in writable} == {
        address: raw for address, raw in before.items() if address in writable
    }


@pytest.mark.parametrize("case", cases_without_status(), ids=repr)
def test_restore_is_refused_if_the_model_has_no_status(case):
    virtual = case.new()
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = case.drive(bus)
        saved = back_up(drive)
        assert case.change(virtual, Random(3))
        changed = case.held(virtual)
        with pytest.raises(NotSupported, match=f"model {case.model.name} has no status, so"):
            carry_out_plan(drive, plan_restore(drive, saved))
    assert case.held(virtual) == changed


def inverter(bus, address=1, **options):
    return bus.drive("fuji", address, model="frenic", **options)


class TestValueOfUnknownScale:
    @pytest.fixture
    def virtual(self):
        return virtual_drive("fuji", 1, model="frenic")

    @pytest.fixture
    def bus(self, virtual):
        with drivecomm.open_bus(VirtualLine([virtual, virtual_drive("fuji", 2, model="frenic")]).port) as bus:
            yield bus

    def test_value_of_unknown_scale_is_restored_by_its_raw_number(self, bus, virtual):
        virtual.poke("F11", 912)
        saved = back_up(inverter(bus))
        assert (saved.entries["F11"].value, saved.entries["F11"].unit) == (912, "")
        virtual.poke("F11", 1)
        done = carry_out_plan(inverter(bus), plan_restore(inverter(bus), saved))
        assert (done.written, done.complete, virtual.peek("F11", 0.0)) == (("F11",), True, 912)

    def test_value_of_unknown_scale_is_restored_after_the_scale_becomes_known(self, bus, virtual):
        virtual.poke("F11", 912)
        saved = back_up(inverter(bus))
        virtual.poke("F11", 1)
        known = inverter(bus, rating_hp=50)
        assert carry_out_plan(known, plan_restore(known, saved)).written == ("F11",)
        assert virtual.peek("F11", 0.0) == 912

    @pytest.mark.parametrize("rated_hp", [{}, {"rating_hp": 50}], ids=["no rating", "another rating"])
    @pytest.mark.parametrize("held", [500, 0])
    def test_value_is_restored_by_its_raw_number_under_another_scale(self, bus, virtual, rated_hp, held):
        virtual.poke("F11", 910)
        saved = back_up(inverter(bus, rating_hp=10))
        assert (saved.entries["F11"].value, saved.entries["F11"].unit) == (Decimal("9.10"), "A")
        virtual.poke("F11", held)
        drive = inverter(bus, **rated_hp)
        done = carry_out_plan(drive, plan_restore(drive, saved))
        assert (done.written, done.complete, virtual.peek("F11", 0.0)) == (("F11",), True, 910)

    def test_value_edited_in_the_file_overrides_its_raw_number(self, bus, virtual):
        virtual.poke("F11", 910)
        saved = back_up(inverter(bus, rating_hp=10))
        entry = replace(saved.entries["F11"], value=Decimal("8.55"))
        saved = replace(saved, entries={**saved.entries, "F11": entry})
        with pytest.raises(ValueRefusedError, match="rating_hp"):
            plan_restore(inverter(bus), saved)
        drive = inverter(bus, rating_hp=10)
        assert carry_out_plan(drive, plan_restore(drive, saved)).written == ("F11",)
        assert virtual.peek("F11", 0.0) == 855

    def test_value_of_unknown_scale_is_not_restored_to_another_drive(self, bus):
        saved = back_up(inverter(bus))
        other = inverter(bus, 2)
        plan = plan_restore(other, saved, RestoreOptions(another_drive=True))
        assert [item.address for item in plan.missed] == ["F11"]
        assert not carry_out_plan(other, plan).complete


def test_unwritable_value_that_holds_already_is_not_missed():
    virtual = virtual_drive("danfoss-fc", 1, model="fc101")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("danfoss-fc", 1, model="fc101")
        saved = back_up(drive)
        assert plan_restore(drive, saved).missed == []
        virtual.poke("0-37", "OTHER")
        (missed,) = plan_restore(drive, saved).missed
        assert (missed.address, missed.current) == ("0-37", "OTHER")
        assert "reading texts only" in missed.reason


def test_values_missing_from_the_backup_are_listed_in_the_remarks():
    lacking = replace(a_set(_104=1), not_read={"103": "no bus access"})
    assert "not in the set, because it could not be read: 103" in plan_restore(FakeDrive(), lacking).remarks


def test_unrequested_communication_setting_does_not_count_as_missed():
    drive = FakeDrive()
    plan = plan_restore(drive, a_set(_106=1))
    assert [item.address for item in plan.to("skip")] == ["106"]
    assert plan.missed == []
    assert [
        item.address for item in plan_restore(drive, a_set(_106=1), RestoreOptions(only=frozenset({"106"}))).missed
    ] == ["106"], "it was asked for by its name"


def test_restore_to_a_read_only_drive_is_refused():
    with drivecomm.open_bus(VirtualLine([virtual_drive("vabus", 1)]).port) as bus:
        saved = back_up(bus.drive("vabus", 1, model="agile"))
        shut = bus.drive("vabus", 1, model="agile", read_only=True)
        shut.read_only_reason = "it is not armed"
        with pytest.raises(ReadOnlyError, match="it is not armed; nothing was written"):
            plan_restore(shut, saved)


def test_watchdog_is_restored_last_and_only_when_it_is_named():
    virtual = virtual_drive("danfoss-fc", 1, model="fc300")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("danfoss-fc", 1, model="fc300")
        saved = back_up(drive)
        for address, raw in {"8-03": 40, "8-04": 5, "3-41": 900, "14-21": 3, "4-14": 300}.items():
            virtual.poke(address, raw)
        plan = plan_restore(drive, saved)
        assert {item.address: item.reason for item in plan.to("skip") if item.address in ("8-03", "8-04")} == {
            "8-03": "a bus switches the watchdog on for a time; name it with --only to restore it",
            "8-04": "a bus switches the watchdog on for a time; name it with --only to restore it",
        }
        assert plan.missed == []
        named = RestoreOptions(only=frozenset({"8-03", "8-04", "3-41", "14-21", "4-14"}))
        assert carry_out_plan(drive, plan_restore(drive, saved, named)).written[-2:] == ("8-03", "8-04")


def test_restore_ends_at_the_first_write_to_a_drive_of_another_series():
    with drivecomm.open_bus(VirtualLine([virtual_drive("modbus", 1, model="delta-vfd-b")]).port) as bus:
        delta = bus.drive("modbus", 1, model="delta-vfd-b")
        plan = plan_restore(delta, back_up(delta))
    # Mark every value as changed, because equal values are not written.
    items = tuple(replace(each, action="write") for each in plan.items)
    assert len(items) > 1
    line, sent = VirtualLine([virtual_drive("modbus", 1, model="delta-vfd-e")]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as other, pytest.raises(WrongDriveError):
        carry_out_plan(other.drive("modbus", 1, model="delta-vfd-b"), replace(plan, items=items))
    assert not [each for each in sent if each.what == "sent" and each.data[1] == 0x06]
