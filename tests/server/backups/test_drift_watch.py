"""Comparison of drives with their baselines after each backup; virtual drives answer in real time."""

import asyncio
import time
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from running_backups import backing
from served_core import ENGINEER, asked, awaited, core_of, until

from drivecomm.commissioning.drift import approved_set, baseline_path, write_baseline
from drivecomm.commissioning.parameter_sets import Approval, read_set
from drivecomm.server.backups import backing_up
from drivecomm.server.backups.backing_up import Backups
from drivecomm.server.backups.settings import BackupSettings

pytestmark = pytest.mark.soak

SOON = BackupSettings(every_s=1e6, share=1.0)


class Clock:
    """Clock that the test advances.

    It starts at the present time, since drives and approvals use the real time.
    """

    def __init__(self):
        self.off_s = 0.0

    def __call__(self):
        return time.time() + self.off_s


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(backing_up, "LOOK_S", 0.01)
    monkeypatch.setattr(backing_up, "BASELINES_LOOK_S", 0.02)
    monkeypatch.setattr(backing_up, "QUIET_S", 0.0)


@pytest.fixture
def clock():
    return Clock()


def files(folder):
    return sorted((folder / "backups" / "pump").glob("*.toml"))


def accept(folder, by="Anna", **changes):
    """Approve the newest backup of the pump, as `drivecomm baseline accept --from` does."""
    approval = Approval(by=by, time=datetime.now(UTC))
    known = replace(approved_set(read_set(files(folder)[-1]), approval), **changes)
    write_baseline(baseline_path(folder / "plant.toml", "pump"), known)


def state(core):
    return core.drive("pump").drift


def texts(core):
    return [event.text for event in core.table.events() if event.drive == "pump"]


def about_approval(core):
    return [text for text in texts(core) if "approved" in text or "baseline" in text]


async def first_backup(folder):
    await until(lambda: files(folder), 20)


@awaited
async def test_change_is_reported_with_its_values_until_it_is_approved(tmp_path, clock):
    async with core_of(tmp_path) as (core, control), backing(core, tmp_path, clock, {"pump": SOON}):
        assert state(core).state == "not compared"
        await until(lambda: state(core).state == "no baseline")
        await first_backup(tmp_path)
        accept(tmp_path)
        await until(lambda: state(core).state == "as approved")
        assert (state(core).approved_by, state(core).changed) == ("Anna", 0)
        control.order("set", drive="pump", parameter="482[1]", value=1100)
        clock.off_s += 2e6
        await until(lambda: state(core).state == "changed", 20)
        (change,) = state(core).changes
        assert (change.address, change.unit, str(change.now)) == ("482[1]", "Hz", "11.00")
        assert change.since_s == state(core).compared_s == pytest.approx(clock(), abs=30)
        text = f"not set as approved, 1 parameter differs: {change}"
        assert about_approval(core) == [text]
        await until(lambda: len(files(tmp_path)) == 2)
        accept(tmp_path, by="Ben")
        await until(lambda: state(core).state == "as approved")
        again = f"set as approved again by the new baseline of Ben, nothing differs: 482[1] {change.name}"
        assert about_approval(core) == [text, again]


@awaited
async def test_change_through_this_server_names_its_author(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        accept(tmp_path)
        await until(lambda: state(core).state == "as approved")
        write = {"parameter": "481", "value": 12, "store": True}
        assert (await asked(core, ENGINEER, "pump", "write", arguments=write)).outcome == "done"
        clock.off_s += 2e6
        await until(lambda: about_approval(core), 20)
        assert " -> 12.00 Hz (eva (local), " in about_approval(core)[0]
        assert about_approval(core)[0].endswith(" UTC, audit record 1)")


@awaited
async def test_restart_keeps_the_time_of_a_change_and_reports_nothing_twice(tmp_path, clock):
    async with core_of(tmp_path) as (core, control):
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await first_backup(tmp_path)
            accept(tmp_path)
            control.order("set", drive="pump", parameter="482[1]", value=1100)
            clock.off_s += 2e6
            await until(lambda: state(core).state == "changed", 20)
            await until(lambda: "482[1]" in (tmp_path / "state" / "drift.json").read_text())
            before = state(core)
        core.drift.clear()
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await until(lambda: state(core).state == "changed")
            await asyncio.sleep(0.2)
        assert state(core).changes == before.changes
        # Without the drift file, the stored backups give the time of the change.
        (tmp_path / "state" / "drift.json").unlink()
        core.drift.clear()
        assert len(about_approval(core)) == 1
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await until(lambda: state(core).state == "changed")
        assert state(core).since_s == pytest.approx(before.since_s, abs=1.0)


@awaited
async def test_baseline_newer_than_the_last_backup_counts_as_the_state_of_the_drive(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        known = read_set(files(tmp_path)[-1])
        entries = {**known.entries, "482[1]": replace(known.entries["482[1]"], value=11)}
        accept(tmp_path, time=datetime.fromtimestamp(clock() + 60, UTC), entries=entries)
        await until(lambda: state(core).state != "no baseline")
        assert (state(core).state, state(core).changed) == ("as approved", 0)


@awaited
async def test_unreadable_baseline_is_reported_once_and_backups_continue(tmp_path, clock):
    async with core_of(tmp_path) as (core, control), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        accept(tmp_path)
        await until(lambda: state(core).state == "as approved")
        baseline_path(tmp_path / "plant.toml", "pump").write_text("half a fi")
        await until(lambda: state(core).state == "not compared")
        assert state(core).changed is None
        control.order("set", drive="pump", parameter="482[1]", value=1100)
        clock.off_s += 2e6
        await until(lambda: len(files(tmp_path)) == 2, 20)
        await asyncio.sleep(0.2)
        (told,) = about_approval(core)
        assert told.startswith("cannot be compared with its baseline: ")
        assert "pump.toml" in told


@awaited
async def test_removed_baseline_is_reported(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        accept(tmp_path)
        await until(lambda: state(core).state == "as approved")
        baseline_path(tmp_path / "plant.toml", "pump").unlink()
        await until(lambda: state(core).state == "no baseline")
        assert about_approval(core) == ["its baseline is gone, so drift is no longer detected"]


@awaited
async def test_different_drive_model_is_reported_as_replaced(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        accept(tmp_path, model="another model")
        await until(lambda: state(core).state == "replaced")
        assert "--another-drive" in state(core).restore
        assert about_approval(core)[0].endswith(f"to give it the approved set: {state(core).restore}")


@awaited
async def test_drive_that_is_not_backed_up_is_not_compared(tmp_path, clock):
    async with core_of(tmp_path) as (core, _):
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await first_backup(tmp_path)
            accept(tmp_path)
            await until(lambda: state(core).state == "as approved")
        async with backing(core, tmp_path, clock, {}):
            await until(lambda: state(core).state == "not compared")
            assert "the server does not back it up" in state(core).cause
        assert about_approval(core) == []


@awaited
async def test_older_backup_does_not_replace_an_unreadable_newer_one(tmp_path, clock):
    async with core_of(tmp_path) as (core, control):
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await first_backup(tmp_path)
            accept(tmp_path)
            control.order("set", drive="pump", parameter="482[1]", value=1100)
            clock.off_s += 2e6
            await until(lambda: state(core).state == "changed", 20)
            await until(lambda: "482[1]" in (tmp_path / "state" / "drift.json").read_text())
        files(tmp_path)[-1].write_text("half a fi")
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await until(lambda: state(core).state == "not compared")
        assert files(tmp_path)[-1].name in state(core).cause


@awaited
async def test_drive_approved_during_a_backup_is_as_approved(tmp_path, clock, monkeypatch):
    read = Backups._read

    async def approved_meanwhile(self, drive, settings, extent):
        found = await read(self, drive, settings, extent)
        if clock.off_s:
            entries = {**found.entries, "482[1]": replace(found.entries["482[1]"], value=11)}
            accept(tmp_path, time=datetime.fromtimestamp(clock() + 1, UTC), entries=entries)
            clock.off_s += 60
        return found

    monkeypatch.setattr(Backups, "_read", approved_meanwhile)
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}):
        await first_backup(tmp_path)
        clock.off_s += 2e6
        await until(lambda: state(core).approved_by, 20)
        assert (state(core).state, about_approval(core)) == ("as approved", [])


@awaited
async def test_full_backup_does_not_count_as_a_comparison(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"pump": SOON}) as backups:
        await first_backup(tmp_path)
        accept(tmp_path)
        await until(lambda: state(core).state == "as approved")
        compared_s = state(core).compared_s
        drive = core.plant.drive("pump")

        async def read(*_):
            known = read_set(files(tmp_path)[-1])
            return replace(known, entries={**known.entries, "482[1]": replace(known.entries["482[1]"], value=11)})

        backups._read = read
        await backups._back_up(drive, SOON, "everything")
        assert (state(core).state, state(core).compared_s) == ("as approved", compared_s)
