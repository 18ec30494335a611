"""A stop of a drive whose line does not work is not lost: it is sent as soon as the line works again."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from served_core import ENGINEER, VIEWER, NoteBook, asked, awaited, runs, simulated, until

from drivecomm.errors import LeaseError, LinkDownError, PortError
from drivecomm.link import PortProxy
from drivecomm.plant import read_plant
from drivecomm.server.core import Core
from drivecomm.transport import SerialPort

PLANT = """\
format = 1
[[line]]
name = "yard"
listen = "tcp:127.0.0.1:0"
paced = false
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = { model = "fc302" }
"""


class Cable:
    """Opens the ports of a line, and can be pulled."""

    def __init__(self, address):
        self.pulled = False
        self._address = address.partition("://")[2] or address

    def port(self):
        if self.pulled:
            raise PortError("the cable is pulled")
        return Pullable(SerialPort(f"socket://{self._address}"), self)


class Pullable(PortProxy):
    """A port at the end of a cable."""

    def __init__(self, port, cable):
        super().__init__(port)
        self._cable = cable

    def write(self, data):
        if self._cable.pulled:
            raise LinkDownError("the cable is pulled")
        super().write(data)


@asynccontextmanager
async def running(tmp_path):
    """Yield a core whose only motor runs, what controls the virtual drive, and the cable between."""
    file = tmp_path / "plant.toml"
    file.write_text(PLANT)
    plant = read_plant(file)
    with simulated(plant) as (server, control):
        cable = Cable(server.addresses["yard"])
        async with Core(
            plant, session="s", audit=NoteBook(), status_period_s=0.02, port_of=lambda _: cable.port
        ) as core:
            await until(lambda: core.drive("fan").reachability == "answers")
            assert (await asked(core, ENGINEER, "fan", "set_reference", arguments={"percent": 50})).outcome == "done"
            assert (await asked(core, ENGINEER, "fan", "start")).outcome == "done"
            yield core, control, cable


async def pull(core, cable):
    cable.pulled = True
    await until(lambda: not core.lines["yard"].state().up)


def told(core):
    return [each.text for each in core.table.events() if each.kind == "command"]


@pytest.mark.soak
@awaited
async def test_it_is_sent_when_the_line_works_again(tmp_path):
    async with running(tmp_path) as (core, control, cable):
        await pull(core, cable)
        assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
        warnings = [each.text for each in core.table.events() if each.kind == "warning"]
        assert any(each.startswith("stop is not confirmed: ") for each in warnings)
        assert runs(control, "fan")
        # Nothing starts before it was sent.
        refused = await asked(core, ENGINEER, "fan", "start")
        assert (refused.outcome, type(refused.error)) == ("refused", LeaseError)
        cable.pulled = False
        await until(lambda: "stop (ramp), sent when the line worked again" in told(core))
        await until(lambda: not runs(control, "fan"), 15)


@pytest.mark.soak
@awaited
async def test_a_later_stop_that_is_sent_takes_its_place(tmp_path):
    async with running(tmp_path) as (core, _, cable):
        await pull(core, cable)
        assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
        cable.pulled = False
        assert (await asked(core, VIEWER, "fan", "stop", arguments={"how": "coast"})).outcome == "done"
        assert (await asked(core, ENGINEER, "fan", "start")).outcome == "done"
        await asyncio.sleep(0.7)
        assert "stop (ramp), sent when the line worked again" not in told(core)
        assert core.drive("fan").status.running


@awaited
async def test_a_server_that_ends_sends_it_no_more(tmp_path):
    async with running(tmp_path) as (core, _, cable):
        await pull(core, cable)
        assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
        await core.release_all()
        assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
        await asyncio.sleep(0)
        assert not [task for task in asyncio.all_tasks() if task.get_name() == "stopping fan"]
