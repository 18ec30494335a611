"""Checks of the poll plan when a plant is served: unreadable quantities, and overloaded lines."""

import asyncio
import signal
import subprocess
import sys
import time

import pytest
from processes import serving
from served_core import awaited, core_of, until

from drivecomm.errors import FileFormatError
from drivecomm.plant import read_plant, read_served_plant
from drivecomm.server import line_loads, served_line
from drivecomm.server.plan_check import report_overload

HEAD = """\
format = 1
[server]
status_period_s = {status_period_s}
[[line]]
name = "yard"
listen = "tcp:127.0.0.1:0"
paced = {paced}
[[line]]
name = "empty"
listen = "tcp:127.0.0.1:0"
"""
DRIVE = """\
[[drive]]
name = "fan{address}"
drive = "danfoss-fc:{address}"
line = "yard"
options = {{ model = "fc302", baudrate = {baudrate} }}
poll = [{{ parameters = {parameters}, period_s = {period_s} }}]
"""


def plant_text(drives, *, baudrate=9600, period_s=0.6, status_period_s=0.3, parameters='["16-13"]', paced="false"):
    told = {"baudrate": baudrate, "parameters": parameters, "period_s": period_s}
    made = (DRIVE.format(address=number, **told) for number in range(1, drives + 1))
    return HEAD.format(status_period_s=status_period_s, paced=paced) + "".join(made)


def file_of(tmp_path, text):
    file = tmp_path / "plant.toml"
    file.write_text(text)
    return file


def test_load_of_a_line_counts_the_statuses(tmp_path):
    plant = read_plant(file_of(tmp_path, plant_text(12)))
    (often,), (seldom,) = (list(line_loads(plant, period_s)) for period_s in (0.3, 60))
    assert (often.line, often.fits, seldom.fits) == ("yard", False, True)
    assert often.utilisation > 1 > seldom.utilisation
    assert often.text.startswith("does not keep up: its polls, and the status of each drive every 0.3 s, need ")
    assert "times as long would fit" in often.text


@awaited
async def test_overload_is_found_by_a_separate_process(tmp_path):
    found = []
    await report_overload(file_of(tmp_path, plant_text(12)), lambda *told: found.append(told), after_s=0)
    ((line, text),) = found
    assert line == "yard"
    assert "does not keep up" in text


@awaited
async def test_plan_that_fits_is_not_reported(tmp_path):
    found = []
    file = file_of(tmp_path, plant_text(1, period_s=5, status_period_s=5))
    await report_overload(file, lambda *told: found.append(told), after_s=0)
    assert found == []


@awaited
async def test_check_that_is_cancelled_leaves_no_process(tmp_path):
    made = []
    usual = asyncio.create_subprocess_exec

    async def started(*words, **options):
        made.append(await usual(*words, **options))
        return made[-1]

    asyncio.create_subprocess_exec = started
    try:
        checking = asyncio.create_task(report_overload(file_of(tmp_path, plant_text(12)), print, after_s=0))
        await until(lambda: made)
        checking.cancel()
        await asyncio.gather(checking, return_exceptions=True)
    finally:
        asyncio.create_subprocess_exec = usual
    assert made[0].returncode is not None


@awaited
async def test_line_that_keeps_missing_polls_is_reported_once_and_at_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(served_line, "MISSING_S", 0.3)
    text = plant_text(1, period_s=0.005, status_period_s=1, paced="true")
    async with core_of(tmp_path, text, status_period_s=1) as (core, _):

        def told():
            return [each.text for each in core.table.events() if each.kind == "line" and "poll" in each.text]

        await until(told)
        (begun,) = told()
        assert begun.startswith("misses polls: it had no time for ")
        line = core.lines["yard"]
        assert line.state().missed
        await line.pause()
        line.look(time.monotonic() + served_line.LATE_OVER_S + 1)
        assert told()[1:] == [each for each in told() if each.startswith("keeps up with its polls again (")]
        assert len(told()) == 2


WRONG = plant_text(1, parameters='["16-13", "output_colour"]')


REFUSED = {
    WRONG: "drive fan1 cannot be polled for output_colour: ",
    plant_text(1).replace("[[drive]]", '[[drive]]\nconfirmed = ["output_curent"]'): (
        "drive fan1: model fc302 has no parameter 'output_curent' that could be confirmed; did you mean "
        "'output_current'?"
    ),
}


@pytest.mark.parametrize("options", [(), ("--check",)], ids=["serve", "check"])
@pytest.mark.parametrize(("text", "why"), REFUSED.items(), ids=["poll", "confirmed"])
def test_serve_refuses_a_plant_file_with_a_quantity_unknown_to_the_model(tmp_path, text, why, options):
    file = file_of(tmp_path, text)
    command = [sys.executable, "-m", "drivecomm", "serve", str(file), *options]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert f"{file}: {why}" in ended.stderr


def test_reload_with_a_quantity_unknown_to_the_model_changes_nothing(tmp_path):
    with serving(tmp_path) as server:

        def values():
            return {each["name"] for each in server.ask("/api/v1/values") if each["drive"] == "fan"}

        server.until(lambda: "output_frequency" in values())
        good = server.plant.read_text()
        server.plant.write_text(good.replace('"output_frequency"', '"output_colour"'))
        server.process.send_signal(signal.SIGHUP)
        server.until(
            lambda: any(
                "drive fan cannot be polled for output_colour" in each["text"] for each in server.events("warning")
            )
        )
        assert values() == {"status", "output_frequency"}


@awaited
async def test_unreadable_quantity_is_bad_with_a_time_and_its_cause(tmp_path):
    began_s = time.time()
    async with core_of(tmp_path, WRONG) as (core, _):
        await until(lambda: core.table.value("fan1", "output_colour"))
        value = core.table.value("fan1", "output_colour")
        assert (value.quality, value.unreadable) == ("bad", True)
        assert began_s - 1 < value.time_s < time.time() + 1
        assert "output_colour" in value.cause


def test_drives_with_the_same_error_share_a_sentence(tmp_path):
    drives = "".join(
        f'[[drive]]\nname = "mixer {address}"\ndrive = "vlt3500:{address}"\nline = "hall"\n'
        'poll = [{ parameters = ["output_frequency"] }]\n'
        for address in range(1, 8)
    )
    file = tmp_path / "plant.toml"
    file.write_text(f'format = 1\n[[line]]\nname = "hall"\nport = "/dev/none"\n{drives}', encoding="utf-8")
    with pytest.raises(FileFormatError) as refused:
        read_served_plant(file)
    named = ", ".join(f"mixer {address}" for address in range(1, 6))
    assert f"drives {named}, and 2 more cannot be polled for output_frequency: " in str(refused.value)
    assert str(refused.value).count("cannot be polled") == 1
