"""Drift of a drive from its approved set, with virtual drives of every protocol."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from random import Random

import pytest
from addresses import address_of
from set_drives import cases, cases_with_settings

import drivecomm
from drivecomm.commissioning.drift import (
    approved_set,
    baseline_path,
    drift_between,
    read_baseline,
    read_drift,
    write_baseline,
)
from drivecomm.commissioning.exploring import lasting
from drivecomm.commissioning.parameter_sets import (
    IN_RAM,
    Approval,
    Entry,
    ParameterSet,
    back_up,
    carry_out_plan,
    must_be_free,
    part_of,
    plan_restore,
    read_set,
    write_set,
)
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

BY_ANNA = Approval(by="Anna", why="as it ran in May", time=datetime(2026, 5, 4, 12, tzinfo=UTC))
RESTORED = {case.plugin.name: case for case in cases_with_settings()}
CASES = {**{case.plugin.name: case for case in cases()}, **RESTORED}
each_protocol = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


def a_set(values, **more):
    entries = {address: Entry(address=address, value=value) for address, value in values.items()}
    return ParameterSet(**{"protocol": "vabus", "drive": "vabus:1", "model": "agile", "entries": entries, **more})


def accepted(case, drive, folder):
    path = baseline_path(folder / "plant.toml", repr(case))
    write_baseline(path, approved_set(back_up(drive), BY_ANNA))
    return read_baseline(path)


def test_every_protocol_has_a_baseline_or_nothing_to_approve():
    for plugin in installed.working():
        if plugin.name in CASES:
            continue
        model = load_model(plugin.package, plugin.name, next(iter(model_names(plugin.package, plugin.name))))
        address = address_of(plugin.name)
        line = VirtualLine([virtual_drive(plugin.name, address, model=model)])
        with drivecomm.open_bus(line.port) as bus:
            saved = back_up(bus.drive(plugin.name, address, model=model))
        with pytest.raises(UsageError, match="nothing to approve"):
            approved_set(saved, BY_ANNA)


@each_protocol
def test_drift_is_empty_after_acceptance_and_names_a_changed_setting(case, tmp_path):
    line = VirtualLine([case.new()])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        approved = accepted(case, drive, tmp_path)
        found = read_drift(drive, approved)
        assert found.same
        assert found.equal == len(approved.entries)
        held = case.held(line.drives[0])
        case.change(line.drives[0], Random(3), share=0.1)
        wanted = {address for address, value in case.held(line.drives[0]).items() if value != held[address]}
        found = read_drift(drive, approved)
        assert not found.same
        assert not found.replaced
        told = {each.address: each for each in found.changed}
        assert set(told) == wanted
        for address in wanted:
            info = case.model.parameters.get(address) or case.model.parameters[address.partition("[")[0]]
            assert (told[address].name, told[address].left.value) == (info.name, approved.entries[address].value)
            assert told[address].right.value != told[address].left.value
            assert told[address].left.unit == told[address].right.unit


@each_protocol
def test_drift_is_empty_when_a_measured_value_moves(case, tmp_path):
    references = case.plugin.references(case.type.options, case.model)
    line = VirtualLine([case.new()])
    with drivecomm.open_bus(line.port) as bus:
        drive = case.drive(bus)
        approved = accepted(case, drive, tmp_path)
        moving = [info.address for info in case.model.parameters.values() if part_of(info, references) == "measured"]
        moved = 0
        for address in moving:
            try:
                line.drives[0].poke(address, 1)
            except (drivecomm.errors.DriveCommError, KeyError, ValueError, TypeError):
                continue
            moved += 1
        assert moved or not moving
        found = read_drift(drive, approved)
        assert (found.changed, found.not_comparable, found.equal) == ((), (), len(approved.entries))
        # The identity is measured, too: a changed identity means another drive.
        assert bool(found.replaced or found.untold) == (lasting(found.now.identity) != lasting(approved.identity))


@pytest.mark.parametrize("case", RESTORED.values(), ids=RESTORED)
def test_drift_is_empty_after_a_restore_to_a_fresh_drive(case, tmp_path):
    line = VirtualLine([case.new()])
    case.change(line.drives[0], Random(5))
    with drivecomm.open_bus(line.port) as bus:
        approved = accepted(case, case.drive(bus), tmp_path)
    fresh = VirtualLine([case.new()])
    with drivecomm.open_bus(fresh.port) as bus:
        drive = case.drive(bus)
        assert read_drift(drive, approved).changed
        carry_out_plan(drive, plan_restore(drive, approved))
    # A new program does not know which values are only in RAM, so it compares all of them.
    with drivecomm.open_bus(fresh.port) as bus:
        found = read_drift(case.drive(bus), approved)
    assert (found.same, found.in_ram, found.equal) == (True, (), len(approved.entries))


@each_protocol
def test_drive_with_another_identity_is_reported_as_replaced(case, tmp_path):
    with drivecomm.open_bus(VirtualLine([case.new()]).port) as bus:
        drive = case.drive(bus)
        approved = accepted(case, drive, tmp_path)
        identity = lasting(approved.identity)
        if not identity:
            pytest.skip("drives of this protocol tell no identity")
        key = next(iter(identity))
        found = read_drift(drive, replace(approved, identity={**approved.identity, key: "another"}))
    assert found.replaced == f"its {key} is 'another', and {identity[key]!r} on this drive"
    assert not found.same
    assert not found.changed


def test_values_that_the_program_wrote_to_ram_are_not_drift(tmp_path):
    case = CASES["vabus"]
    with drivecomm.open_bus(VirtualLine([case.new()]).port) as bus:
        drive = case.drive(bus)
        approved = accepted(case, drive, tmp_path)
        drive.write("481[1]", 12)
        found = read_drift(drive, approved)
        assert found.same
        assert "481[1]" in found.in_ram
        drive.write("481[1]", 12, store=True)
        assert "481[1]" in [each.address for each in read_drift(drive, approved).changed]


def test_unreadable_value_is_not_comparable_and_never_equal():
    then = a_set({"1": 1, "2": 2, "3": 3, "4": 4, "9": 9}, not_read={"5": "refused", "6": "refused"})
    now = a_set({"1": 1, "5": 5, "7": 7}, not_read={"2": "refused", "3": IN_RAM, "6": "refused"})
    found = drift_between(then, now, live={"9"})
    assert [(each.address, each.kind, each.reason) for each in found.not_comparable] == [
        ("2", "not comparable", "refused"),
        ("5", "not comparable", "refused"),
        ("4", "not comparable", "the drive's model has no such setting now"),
    ]
    assert (found.equal, found.changed, found.same) == (1, (), False)
    assert (found.in_ram, found.never_read, found.unapproved) == (("3",), ("6",), ("7",))


def test_drive_that_no_longer_reports_its_identity_is_not_the_same():
    then = a_set({"1": 1}, identity={"serial number": "7", "software": "1"})
    found = drift_between(then, a_set({"1": 1}))
    assert (found.untold, found.replaced, found.same) == (("serial number",), "", False)
    assert drift_between(then, a_set({"1": 1}, identity={"serial number": "7"})).same


@pytest.mark.parametrize("now", [{"drive": "vabus:2"}, {"model": "acu"}, {"protocol": "fuji"}], ids=str)
def test_other_address_model_or_protocol_in_the_plant_means_replaced(now):
    found = drift_between(a_set({"1": 1}), a_set({"1": 2}, **now))
    assert found.replaced
    assert not found.same


def test_approved_set_holds_only_settings():
    shown = {part: Entry(address=part, value=1, part=part) for part in ("settings", "measured", "unknown")}
    assert list(approved_set(a_set({}, entries=shown), BY_ANNA).entries) == ["settings"]


def test_baseline_files_of_different_drives_never_collide():
    names = ["pump", "Pump", "PUMP", "pump 1", "pump/1", "../pump", "pump%201", "vabus:1", "con", "CON", "pümp", "p~1"]
    paths = [baseline_path(Path("hall/plant.toml"), name) for name in names]
    assert len({str(path).lower() for path in paths}) == len(names)
    assert {path.parent for path in paths} == {Path("hall/baselines")}
    assert paths[names.index("con")].name == "con~0.toml", "con.toml is a device of Windows"
    assert [path.name for path in paths[:4]] == ["pump.toml", "Pump~1.toml", "PUMP~f.toml", "pump%201.toml"]


class TestFile:
    def test_approved_set_is_readable_as_a_parameter_set(self, tmp_path):
        path = tmp_path / "baselines" / "pump.toml"
        approved = approved_set(a_set({"1": 1}), BY_ANNA)
        write_baseline(path, approved)
        assert read_set(path) == read_baseline(path) == approved
        text = path.read_text(encoding="utf-8")
        assert '[approved]\nby = "Anna"\nwhy = "as it ran in May"\ntime = 2026-05-04T12:00:00Z\n' in text
        assert [each.name for each in path.parent.iterdir()] == ["pump.toml"]

    def test_backup_never_replaces_an_approved_set(self, tmp_path):
        path = tmp_path / "baselines" / "pump.toml"
        write_baseline(path, approved_set(a_set({"1": 1}), BY_ANNA))
        with pytest.raises(UsageError, match="only drivecomm baseline accept replaces"):
            must_be_free(path, "vabus:1")

    def test_set_without_an_approval_is_not_a_baseline(self, tmp_path):
        write_set(tmp_path / "pump.toml", a_set({"1": 1}))
        with pytest.raises(FileFormatError, match=r"is not approved.* --from"):
            read_baseline(tmp_path / "pump.toml")

    @pytest.mark.parametrize(
        ("table", "wrong"),
        [
            ('by = "Anna"', "'time' is missing"),
            ("time = 2026-05-04T12:00:00Z", "'by' is missing"),
            ('by = "Anna"\ntime = 2026-05-04T12:00:00', "with its zone"),
            ('by = "Anna"\ntime = 2026-05-04T12:00:00Z\nwho = "x"', "unknown key 'who'"),
        ],
    )
    def test_malformed_approval_is_refused(self, tmp_path, table, wrong):
        path = tmp_path / "pump.toml"
        head = 'format = 1\nprotocol = "vabus"\ndrive = "vabus:1"\nmodel = "agile"\n'
        path.write_text(f"{head}[approved]\n{table}\n", encoding="utf-8")
        with pytest.raises(FileFormatError, match=wrong):
            read_set(path)
