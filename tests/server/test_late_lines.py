"""A line without time for its status polls is late: no door reports its drives as dead."""

import asyncio
import threading
import time
from contextlib import asynccontextmanager

import pytest
from served_core import awaited, core_of, until

from drivecomm.line import STATUS
from drivecomm.server import table
from drivecomm.server.http.metrics import Metrics
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.served_line import LATE_OVER_S
from drivecomm.server.sparkplug.edge_node import EdgeNode
from drivecomm.server.sparkplug.metrics import QUALITY
from drivecomm.server.spells import Spell


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(table, "LEAST_S", 0.3)


@asynccontextmanager
async def busy(core, line):
    """Keep a line from being polled during the block."""
    done = threading.Event()
    lent = asyncio.create_task(core.lines[line].bus.lend(lambda *_: done.wait(10)))
    try:
        yield
    finally:
        done.set()
        await lent


class NoStreams:
    clients = 0


def scraped(plant):
    return Metrics(plant, "http", NoStreams()).rendered("")[0].decode()


def edge_node(plant):
    return EdgeNode(plant, lambda _: [], lambda *_: (None, None))


def line_events(core, line):
    return [each.text for each in core.table.events() if each.kind == "line" and each.line == line]


def about(core, drive):
    return [(each.kind, each.text) for each in core.table.events() if each.drive == drive]


@awaited
async def test_late_line_is_reported_once_and_its_drives_stay_alive(tmp_path):
    async with core_of(tmp_path) as (core, _):
        plant, line = PlantForDoors(core, "hall"), core.lines["hall"]
        await until(lambda: core.table.value("pump", STATUS) and core.table.value("pump", "output_frequency"))
        node, events = edge_node(plant), len(core.table.events())
        births = {each.device for each in node.births(0, time.time()) if each.kind == "DBIRTH"}
        assert "pump" in births
        async with busy(core, "hall"):
            await until(lambda: core.drive("pump").late)
            state = core.drive("pump")
            assert (state.reachability, state.status.state.value) == ("answers", "not_ready")
            assert "was not polled" in state.error
            assert "pump" in plant.answering()
            messages = node.changed(plant.values(), ["pump"], time.time()) + node.periodic_messages(time.time())
            of_pump = [each for each in messages if each.device == "pump"]
            assert {each.kind for each in of_pump} == {"DDATA"}
            metrics = [metric for each in of_pump for metric in each.metrics]
            assert {metric.properties[QUALITY].value for metric in metrics} == {500}
            assert "not_ready" in {metric.value for metric in metrics}
            told = scraped(plant)
            assert 'drivecomm_drive_up{drive="pump",line="hall"} 1.0' in told
            assert 'drivecomm_line_late_statuses_total{line="hall"} 1.0' in told
            assert 'drivecomm_drive_fault{drive="pump"' not in told
            assert plant.lines()[0].late
        await until(lambda: not core.drive("pump").late)
        assert about(core, "pump") == []
        assert node.is_born("pump")
        # Another late status within the quiet time belongs to the same spell.
        line.status_is_late("pump", "was not asked", time.monotonic())
        line.look(time.monotonic() + LATE_OVER_S - 1)
        assert len(line_events(core, "hall")) == 1
        line.look(time.monotonic() + LATE_OVER_S + 1)
        begun, over = line_events(core, "hall")
        assert begun.startswith("is late: it had no time to poll the status of pump")
        assert over.startswith("polls every status in time again (2 late within")
        assert not plant.lines()[0].late
        assert plant.lines()[0].late_statuses == 2
        assert len(core.table.events()) == events + 2


@awaited
async def test_lost_line_ends_a_late_spell_without_an_in_time_event(tmp_path):
    async with core_of(tmp_path) as (core, _):
        line = core.lines["hall"]
        await until(lambda: core.drive("pump").status is not None)
        line.status_is_late("pump", "was not asked", time.monotonic())
        line._lost("the port has gone")
        assert not core.drive("pump").late
        line.look(time.monotonic() + 2 * LATE_OVER_S)
        assert [each.partition(":")[0] for each in line_events(core, "hall")] == ["is late", "the port has gone"]


def test_spell_begins_only_when_incidents_recur():
    spell = Spell(begins_after_s=10, quiet_s=30)
    assert [spell.seen(at, 2) for at in (0, 40, 45, 50, 60)] == [False, False, False, True, False]
    assert (spell.incidents, spell.lasted_s) == (8, 20)
    assert [spell.ends(at) for at in (90, 91, 92)] == [False, True, False]
    assert spell.seen(92) is False
    assert spell.incidents == 1
