"""Values that a busy line does not read: no door shows them as good, or as new when they are read again."""

import asyncio
import json
import threading
from contextlib import asynccontextmanager

import pytest
from served_core import VIEWER, awaited, core_of, until

from drivecomm.server import table
from drivecomm.server.http.content import drive_text
from drivecomm.server.mqtt.content import sample_of
from drivecomm.server.plant_service import PlantForDoors


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(table, "LEAST_S", 0.3)


@asynccontextmanager
async def busy(core, line):
    """Occupy a line during the block."""
    done = threading.Event()
    lent = asyncio.create_task(core.lines[line].bus.lend(lambda *_: done.wait(10)))
    try:
        yield
    finally:
        done.set()
        await lent


def values_of(core, drive):
    return {each.name: each for each in core.table.values() if each.drive == drive}


@pytest.mark.soak
@awaited
async def test_drive_of_a_busy_line_is_late_and_keeps_its_last_values(tmp_path):
    async with core_of(tmp_path) as (core, control):
        plant = PlantForDoors(core, "hall")
        control.order("trip", drive="pump", code=4)
        await until(lambda: core.drive("pump").fault)
        await until(lambda: "output_frequency" in values_of(core, "pump"))
        fault, events = core.drive("pump").fault, len(core.table.events())
        async with busy(core, "hall"):
            await until(lambda: {each.quality for each in values_of(core, "pump").values()} == {"stale"})
            told = json.loads(drive_text(plant, plant.drive("pump"), values_of(core, "pump").values(), VIEWER))
            assert (told["reachability"], told["state"], told["fault"]) == ("answers", "fault", fault)
            assert told["late"]
            assert told["status"]["fault"]
            assert "was not polled" in told["error"]
            assert {each["quality"] for each in told["values"]} == {"stale"}
            assert all(each["reading"] and "was not polled" in each["cause"] for each in told["values"])
            sample = sample_of(values_of(core, "pump")["output_frequency"])
            assert sample.quality == "stale"
            assert sample.source_ms < sample.time_ms
            # The other line is not affected.
            assert core.drive("fan").reachability == "answers"
            assert values_of(core, "fan")["status"].quality == "good"
        await until(lambda: core.drive("pump").reachability == "answers" and not core.drive("pump").late)
        await until(lambda: values_of(core, "pump")["status"].quality == "good")
        assert (core.drive("pump").error, core.drive("pump").fault) == ("", fault)
        assert [each for each in core.table.events()[events:] if each.drive == "pump"] == []


@pytest.mark.soak
@awaited
async def test_value_with_a_long_period_is_not_stale_between_polls(tmp_path):
    async with core_of(tmp_path) as (core, _):
        await until(lambda: "status" in values_of(core, "pump"))
        found = []
        end = core.table.listen(lambda values, _: found.extend(each.quality for each in values))
        await asyncio.sleep(0.6)
        end()
        assert found
        assert "stale" not in found
