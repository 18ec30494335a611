"""Ten days of a plant of forty drives of seven protocols, on a clock that the test advances.

Settings are changed at keypads, drives are replaced, and the server is repeatedly stopped in the middle of its backups.
Every change is found with the correct values, and no other change is reported.
"""

import asyncio
import random
import re
from datetime import UTC, datetime

import pytest
from running_backups import backing
from served_core import awaited, core_of, until

from drivecomm.commissioning.drift import approved_set, baseline_path, write_baseline
from drivecomm.commissioning.parameter_sets import Approval, read_set
from drivecomm.server.backups import backing_up
from drivecomm.server.backups.settings import BackupSettings

DAY_S = 86400.0
DAYS, CHANGES, ENDS = 10, 25, 20
DAILY = BackupSettings(every_s=DAY_S, share=1.0)
SERIES = {
    "vabus": ("agile", "482[1]", (1100, 2900)),
    "danfoss-fc": ("fc302", "3-41", (200, 6000)),
    "vlt3500": ("vlt3500", "215", (20, 90)),
    "fuji": ("frenic", "F07", (500, 2900)),
    "uss": ("micromaster4", "1120", (20, 90)),
    "modbus": ("delta", "0x0903", (20, 900)),
    "mitsubishi": ("fr700", "72", (3, 14)),
}
"""By protocol: a model, one of its settings, and valid raw values of that setting."""


def plant_text():
    parts = ["format = 1"]
    for place, (protocol, (model, *_)) in enumerate(SERIES.items()):
        parts.append(f'[[line]]\nname = "{protocol}"\nlisten = "tcp:127.0.0.1:0"\npaced = false')
        parts += [
            f'[[drive]]\nname = "{protocol} {address}"\ndrive = "{protocol}:{address}"\nline = "{protocol}"\n'
            f'options = {{ model = "{model}" }}'
            for address in range(1, 7 if place < 5 else 6)
        ]
    return "\n".join(parts)


class Clock:
    """The server's clock, which the test advances."""

    now_s = datetime.now(UTC).timestamp()

    def __call__(self):
        return self.now_s


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(backing_up, "LOOK_S", 0.01)
    monkeypatch.setattr(backing_up, "BASELINES_LOOK_S", 0.05)
    monkeypatch.setattr(backing_up, "QUIET_S", 0.0)


def daily(core):
    return {each.name: DAILY for each in core.plant.drives}


def drift_of(core, name):
    return core.drive(name).drift


def all_are_read(core, clock):
    """Return whether every drive has been read and compared today."""
    return all((drift_of(core, each.name).compared_s or 0.0) >= clock.now_s for each in core.plant.drives)


async def cut_short(core, folder, clock, chance, times):
    """Start backups and interrupt them at a random moment, this number of times."""
    for _ in range(times):
        async with backing(core, folder, clock, daily(core)):
            await asyncio.sleep(chance.uniform(0.01, 0.6))


def approve(folder, name):
    path = max((folder / "backups" / name.replace(" ", "%20")).glob("*.toml"))
    approval = Approval(by="Anna", time=datetime.fromtimestamp(0, UTC))
    write_baseline(baseline_path(folder / "plant.toml", name), approved_set(read_set(path), approval))


def of_another_drive(folder, name):
    """Change the baseline of a drive so that its identity no longer matches the drive."""
    path = baseline_path(folder / "plant.toml", name)
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r'(\[identity\]\n[^=]* = )"[^"]*"', r'\1"another"', text), encoding="utf-8")


@pytest.mark.soak
@pytest.mark.timeout(600)
@awaited
async def test_ten_days_of_backups_report_every_change_and_no_other(tmp_path):
    chance, clock = random.Random(5), Clock()
    async with core_of(tmp_path, plant_text(), status_period_s=1.0) as (core, control):
        names = [each.name for each in core.plant.drives]
        assert len(names) == 40
        async with backing(core, tmp_path, clock, daily(core)):
            await until(lambda: all((tmp_path / "backups" / name.replace(" ", "%20")).is_dir() for name in names), 120)
            for name in names:
                approve(tmp_path, name)
            await until(lambda: all(drift_of(core, name).state == "as approved" for name in names), 60)

        changed = {}
        days = [chance.randrange(DAYS) for _ in range(CHANGES)]
        ends = [chance.randrange(DAYS) for _ in range(ENDS)]
        for day in range(DAYS):
            clock.now_s += DAY_S + 1
            for name in chance.sample([each for each in names if each not in changed], days.count(day)):
                _, parameter, values = SERIES[name.partition(" ")[0]]
                control.order("set", drive=name, parameter=parameter, value=chance.randrange(*values))
                changed[name] = clock.now_s
            await cut_short(core, tmp_path, clock, chance, ends.count(day))
            async with backing(core, tmp_path, clock, daily(core)):
                await until(lambda: all_are_read(core, clock), 120)
            for name in names:
                drift = drift_of(core, name)
                parameter = SERIES[name.partition(" ")[0]][1]
                assert [each.address for each in drift.changes] == ([parameter] if name in changed else []), name
                if name in changed:
                    (change,) = drift.changes
                    reading = await core.line(core.plant.drive(name).line).drive(name).read(parameter)
                    assert change.approved != change.now == reading.value, name
                    # The name of a backup file gives its time in whole seconds.
                    assert changed[name] - 1 < change.since_s < changed[name] + 120, name

        assert len(changed) == CHANGES
        others = [f"{protocol} {address}" for protocol in ("danfoss-fc", "fuji") for address in range(1, 6)]
        for name in others:
            of_another_drive(tmp_path, name)
        async with backing(core, tmp_path, clock, daily(core)):
            await until(lambda: all(drift_of(core, name).state == "replaced" for name in others), 60)
            await asyncio.sleep(0.5)
        assert [name for name in names if drift_of(core, name).state == "replaced"] == others
        for file in tmp_path.glob("backups/*/*.toml"):
            read_set(file)
        for name in names:
            kept = list((tmp_path / "backups" / name.replace(" ", "%20")).glob("*.toml"))
            assert len(kept) == (2 if name in changed else 1), name
