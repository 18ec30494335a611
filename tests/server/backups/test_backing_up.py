"""Automatic backups by a server, of virtual drives that answer in real time."""

import asyncio
import re

import pytest
from running_backups import backing
from served_core import ENGINEER, asked, awaited, core_of, until

from drivecomm.commissioning.parameter_sets import read_set
from drivecomm.server.backups import backing_up
from drivecomm.server.backups.settings import BackupSettings, PlantBackups
from drivecomm.server.backups.unhurried import PacedDrive

SOON = BackupSettings(every_s=1.0, share=1.0)


class Clock:
    """A clock that the test sets."""

    now_s = 1_800_000_000.0

    def __call__(self):
        return self.now_s


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(backing_up, "LOOK_S", 0.01)


@pytest.fixture
def clock():
    return Clock()


def files(folder, drive):
    return sorted((folder / "backups" / drive).glob("*.toml"))


def texts(core, drive):
    return [event.text for event in core.table.events() if event.drive == drive]


@awaited
async def test_due_drive_is_backed_up_and_a_change_is_reported_with_its_author(tmp_path, clock, monkeypatch):
    async with core_of(tmp_path) as (core, control), backing(core, tmp_path, clock, {"pump": SOON}):
        await until(lambda: files(tmp_path, "pump"), 20)
        before = read_set(files(tmp_path, "pump")[0])
        assert before.drive == "vabus:1"
        assert len(before.entries) > 50
        answer = await asked(
            core, ENGINEER, "pump", "write", arguments={"parameter": "481", "value": 12, "store": True}
        )
        assert answer.outcome == "done", answer
        control.order("set", drive="pump", parameter="482", value=1100)
        clock.now_s += 2
        # A write blocks backups of the drive for a while, so that a running restore is not disturbed.
        await asyncio.sleep(0.2)
        assert len(files(tmp_path, "pump")) == 1
        monkeypatch.setattr(backing_up, "QUIET_S", 0.0)
        await until(lambda: len(files(tmp_path, "pump")) == 2, 20)
        await until(lambda: any("settings differ" in text for text in texts(core, "pump")))
        told = next(text for text in texts(core, "pump") if "settings differ" in text)
        assert f"settings differ from backup {files(tmp_path, 'pump')[0].name}: 481" in told
        assert re.search(r"12\.00 Hz \(eva \(local\), [-0-9]+ [:0-9]+ UTC, audit record 1\), 482", told)


@awaited
async def test_drive_is_not_read_again_before_its_backup_is_due(tmp_path, clock, monkeypatch):
    reads = 0
    read = PacedDrive.read

    def counting(self, *values, **options):
        nonlocal reads
        reads += 1
        return read(self, *values, **options)

    monkeypatch.setattr(PacedDrive, "read", counting)
    async with core_of(tmp_path) as (core, _):
        async with backing(core, tmp_path, clock, {"fan": SOON}):
            await until((tmp_path / "state" / "backups.json").exists, 20)
            whole = reads
            await asyncio.sleep(0.1)
            assert reads == whole
        # The time of the last backup survives a restart of the server.
        async with backing(core, tmp_path, clock, {"fan": SOON}):
            await asyncio.sleep(0.1)
            assert reads == whole
            clock.now_s += 1.5
            await until(lambda: reads == 2 * whole, 20)
            await asyncio.sleep(0.1)
        assert len(files(tmp_path, "fan")) == 1


@awaited
async def test_polls_continue_while_a_backup_uses_its_share(tmp_path, clock):
    async with core_of(tmp_path) as (core, _):
        line = core.lines["hall"]
        await until(lambda: line.state().polls > 5)
        async with backing(core, tmp_path, clock, {"pump": BackupSettings(share=0.1)}):
            began = line.state().polls
            await asyncio.sleep(2)
            assert line.state().polls - began > 2 / 0.05 * 2 * 0.8
            assert line.state().missed == 0


@awaited
async def test_silent_drive_is_backed_up_when_it_answers_again(tmp_path, clock):
    async with core_of(tmp_path) as (core, control):
        control.order("power", drive="pump", state="off")
        await until(lambda: core.drive("pump").reachability == "silent", 20)
        async with backing(core, tmp_path, clock, {"pump": SOON}):
            await asyncio.sleep(0.3)
            assert files(tmp_path, "pump") == []
            control.order("power", drive="pump", state="on")
            await until(lambda: files(tmp_path, "pump"), 20)
        assert not any("cannot be backed up" in text for text in texts(core, "pump"))


@awaited
async def test_drive_without_a_model_is_reported_once(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {"mixer": SOON}):
        await until(lambda: any("cannot be backed up" in text for text in texts(core, "mixer")))
        for _ in range(3):
            clock.now_s += backing_up.AGAIN_S + 1
            await asyncio.sleep(0.1)
        assert sum("cannot be backed up" in text for text in texts(core, "mixer")) == 1


@awaited
async def test_full_backup_resumes_after_an_interrupted_run(tmp_path, clock):
    all_of_it = BackupSettings(every_s=1e9, everything_s=1.0, share=1.0)
    asked_for = []
    async with core_of(tmp_path) as (core, _):
        answers = tmp_path / "state" / "backup of pump.toml.answers"
        for least in (20, 60):
            async with backing(core, tmp_path, clock, {"pump": all_of_it}):
                await until(lambda least=least: answers.exists() and len(answers.read_bytes().splitlines()) > least, 60)
            asked_for.append([line.split(b'"')[3] for line in answers.read_bytes().splitlines()[1:]])
        assert asked_for[1][: len(asked_for[0])] == asked_for[0]
        assert len(set(asked_for[1])) == len(asked_for[1])


@awaited
async def test_changed_backup_settings_take_effect_on_reload(tmp_path, clock):
    async with core_of(tmp_path) as (core, _), backing(core, tmp_path, clock, {}) as backups:
        await asyncio.sleep(0.1)
        assert files(tmp_path, "fan") == []
        backups.change(PlantBackups(folder=tmp_path / "backups", git=False, drives={"fan": SOON}))
        await until(lambda: files(tmp_path, "fan"), 20)
