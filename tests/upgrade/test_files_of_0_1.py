"""Files in `from_0_1` were written by drivecomm 0.1.0 on a virtual plant; this version reads and continues them."""

import asyncio
import json
import shutil
import subprocess
import sys
from decimal import Decimal
from functools import partial
from pathlib import Path

import pytest

from drivecomm.capture import read_capture
from drivecomm.commissioning.parameter_sets import read_set
from drivecomm.errors import FileFormatError
from drivecomm.models import check_model, read_model
from drivecomm.plant import read_plant
from drivecomm.plant.value_log import read_rows
from drivecomm.protocol import Reading
from drivecomm.server import Audit, Caller, CommandRequest, CurrentValue, Event, Role
from drivecomm.server.history import History, HistoryWriter

FROM_0_1 = Path(__file__).with_name("from_0_1")
BEGINNING, END = 1_795_872_728.0, 1_795_873_400.0


@pytest.fixture
def file(tmp_path):
    """Return a function that copies a file of 0.1 into an empty folder and restores its private permissions."""

    def copied(name):
        path = Path(shutil.copy(FROM_0_1 / name, tmp_path / name))
        path.chmod(0o600)
        return path

    return copied


def drivecomm(*arguments):
    command = [sys.executable, "-m", "drivecomm", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_history_of_0_1_is_read(file):
    with History(file("history.sqlite")) as history:
        assert history.drives() == ["pump", "blower"]
        assert [each.event.text for each in history.events()][:3] == [
            "begins, drivecomm 0.1.0",
            "keep(policy=trip, watchdog_s=5.0, hz=20.0)",
            "running",
        ]
        assert [(each.verb, each.outcome) for each in history.commands()] == [
            ("keep", "done"),
            ("set_reference", "refused"),
            ("set_reference", "done"),
            ("start", "done"),
            ("reset", "done"),
            ("stop", "done"),
        ]
        values = list(history.values("pump", "output_frequency"))
        assert len(values) > 100
        assert values[0].value == Decimal("0.00")
        assert values[-1].value == Decimal("20.00")
        assert {each.unit for each in values} == {"Hz"}
        assert history.fault_logs("blower")


def test_history_of_0_1_is_continued(file):
    path = file("history.sqlite")
    with History(path) as history:
        rows = history.last_row()
    journal = HistoryWriter(path)
    reading = Reading(parameter="210", value=Decimal("33.00"), raw=3300, unit="Hz", time_s=END)
    new = CurrentValue(drive="pump", name="output_frequency", reading=reading, quality="good", cause="", time_s=END)
    journal.add_values([new])
    journal.add_events([Event(number=16, time_s=END, kind="server", text="begins, drivecomm 0.2.0")])
    journal.close()
    with History(path) as history:
        assert history.last_row() == rows + 1
        assert list(history.values("pump", "output_frequency"))[-1].value == Decimal("33.00")
        assert list(history.events())[-1].event.text == "begins, drivecomm 0.2.0"


def test_history_of_0_1_is_shown_by_the_command(file):
    period = ("--from", "2026-11-28", "--to", "2026-11-29")
    shown = drivecomm("history", "pump", "output_frequency", "--file", file("history.sqlite"), *period, "--json")
    assert shown.returncode == 0, shown.stderr
    assert json.loads(shown.stdout.splitlines()[0])["drive"] == "pump"


def test_audit_file_of_0_1_is_continued(file):
    path = file("audit.jsonl")
    before = path.read_bytes()

    async def stop_is_recorded():
        audit = Audit(path, lambda _text: None)
        await audit.record_command(
            Caller(name="anna", role=Role.OPERATE, door="http"), CommandRequest(drive="pump", verb="stop")
        )
        await audit.close()

    asyncio.run(stop_is_recorded())
    after = path.read_bytes()
    assert after.startswith(before)
    assert json.loads(after[len(before) :].splitlines()[0])["verb"] == "stop"


def test_plant_file_of_0_1_is_read(file):
    file("users.toml")
    path = file("plant.toml")
    plant = read_plant(path)
    assert [drive.name for drive in plant.drives] == ["pump", "blower"]
    checked = drivecomm("serve", "--check", path)
    assert checked.returncode == 0, checked.stderr


def test_parameter_set_of_0_1_is_read_and_equals_itself():
    assert len(read_set(FROM_0_1 / "pump.toml").entries) == 84
    compared = drivecomm("compare", FROM_0_1 / "pump.toml", FROM_0_1 / "pump.toml")
    assert compared.returncode == 0, compared.stderr


def test_model_of_0_1_is_valid():
    assert read_model(FROM_0_1 / "grown.toml", "danfoss-fc").name == "grown"
    assert not list(check_model(FROM_0_1 / "grown.toml"))


def test_value_log_of_0_1_is_read():
    rows = list(read_rows(FROM_0_1 / "values.csv"))
    assert {row.drive for row in rows} == {"pump", "blower"}
    assert rows[0].unit == "Hz"


@pytest.mark.parametrize("name", ["capture.jsonl", "capture.pcapng"])
def test_capture_of_0_1_is_read_and_decoded(name):
    assert [piece.source for piece in read_capture(FROM_0_1 / name).pieces] == ["master", "drive", "master"]
    sniffed = drivecomm("sniff", FROM_0_1 / name)
    assert sniffed.returncode == 0, sniffed.stderr
    assert "vabus:1" in sniffed.stdout


def test_users_of_0_1_keep_their_roles(file):
    listed = drivecomm("users", "list", "--file", file("users.toml"))
    assert listed.returncode == 0, listed.stderr
    assert "anna" in listed.stdout
    assert "operate" in listed.stdout


@pytest.mark.parametrize(
    ("name", "ours", "newer", "read"),
    [
        ("plant.toml", "format = 1", "format = 2", read_plant),
        ("pump.toml", "format = 1", "format = 2", read_set),
        ("grown.toml", "format = 1", "format = 2", partial(read_model, protocol="danfoss-fc")),
        ("capture.jsonl", '"version": 1', '"version": 2', read_capture),
    ],
)
def test_file_of_a_newer_format_is_refused_with_its_name(file, name, ours, newer, read):
    path = file(name)
    path.write_text(path.read_text().replace(ours, newer, 1))
    with pytest.raises(FileFormatError, match=name):
        read(path)
