"""Events after a drive was silent: changes are reported when it answers again, and unchanged facts are not repeated."""

import pytest
from served_core import awaited, core_of, until


def about(core, drive):
    return [(each.kind, each.text) for each in core.table.events() if each.drive == drive and each.kind != "link loss"]


def kinds(core, drive):
    return [kind for kind, _ in about(core, drive)]


async def silent_and_back(core, control, drive, meanwhile=None):
    """Switch a drive off and on again. meanwhile: called while the drive is off."""
    control.order("power", drive=drive, state="off")
    await until(lambda: core.drive(drive).reachability == "silent")
    if meanwhile is not None:
        meanwhile()
    control.order("power", drive=drive, state="on")
    await until(lambda: core.drive(drive).status is not None, 20)


@awaited
async def test_end_of_a_fault_is_reported_when_the_drive_answers_again(tmp_path):
    async with core_of(tmp_path) as (core, control):
        await until(lambda: core.drive("fan").status is not None)
        control.order("trip", drive="fan", code=4)
        await until(lambda: core.drive("fan").fault)
        # Danfoss drives lose a trip when their mains is switched off.
        await silent_and_back(core, control, "fan")
        found = about(core, "fan")
        assert [kind for kind, _ in found] == ["fault", "silent", "answers", "fault over", "state"]
        assert found[-1] == ("state", core.drive("fan").status.state.value.replace("_", " "))


@awaited
async def test_motor_that_stopped_during_a_silence_is_reported_as_stopped(tmp_path):
    async with core_of(tmp_path) as (core, control):
        await until(lambda: core.drive("fan").status is not None)
        fan = core.lines["yard"].drive("fan")
        await fan.set_reference(percent=40)
        await fan.start()
        await until(lambda: core.drive("fan").status.running)
        await silent_and_back(core, control, "fan")
        assert not core.drive("fan").status.running
        states = [text for kind, text in about(core, "fan") if kind == "state"]
        assert states[-1] == core.drive("fan").status.state.value.replace("_", " ")


@pytest.mark.soak
@awaited
async def test_fault_that_lasts_through_a_silence_is_reported_once(tmp_path):
    async with core_of(tmp_path) as (core, control):
        await until(lambda: core.drive("pump").status is not None)
        control.order("trip", drive="pump", code=4)
        await until(lambda: core.drive("pump").fault)
        now = next(each["time_s"] for each in control.order("show")["lines"] if each["name"] == "hall")
        text = f'line = "hall"\nkind = "drop"\nof = "request"\nfrom_s = {now}\nuntil_s = {now + 3}'
        control.order("fault", text=text)
        await until(lambda: core.drive("pump").reachability == "silent", 10)
        await until(lambda: core.drive("pump").fault, 20)
        assert kinds(core, "pump") == ["fault", "silent", "answers"]
