"""One line of a server: effects of a failed opening, failed polls, and the return of the port."""

from contextlib import asynccontextmanager
from dataclasses import replace
from decimal import Decimal
from typing import ClassVar

from served_core import VIEWER, NoteBook, asked, awaited, simulated, until

from drivecomm.errors import PortError
from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue, served_line
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
options = { model = "fc302" }
"""


class Plug:
    """Opener of the line's port, which fails while the plug is pulled."""

    def __init__(self, address, *, plugged):
        self.plugged = plugged
        self.refused = 0
        self._address = f"socket://{address.partition('://')[2] or address}"

    def port(self):
        if not self.plugged:
            self.refused += 1
            raise PortError("the adapter is not plugged in")
        return SerialPort(self._address)


@asynccontextmanager
async def served(tmp_path, *, plugged=True):
    """Yield a core of one line, the control of its drive, and the plug of the line."""
    file = tmp_path / "plant.toml"
    file.write_text(PLANT)
    plant = read_plant(file)
    with simulated(plant) as (server, control):
        plug = Plug(server.addresses["yard"], plugged=plugged)
        core = Core(plant, session="s", audit=NoteBook(), status_period_s=0.02, port_of=lambda _: plug.port)
        async with core:
            yield core, control, plug


def kinds(core):
    return [each.kind for each in core.table.events() if each.drive == "fan"]


@awaited
async def test_line_that_opens_at_a_later_attempt_carries_stops(tmp_path):
    async with served(tmp_path, plugged=False) as (core, _, plug):
        await until(lambda: plug.refused)
        plug.plugged = True
        await until(lambda: core.drive("fan").status is not None)
        answer = await asked(core, VIEWER, "fan", "stop")
        assert (answer.outcome, answer.error) == ("done", None)


@awaited
async def test_drive_of_a_returned_line_is_reported_silent_once(tmp_path):
    async with served(tmp_path, plugged=False) as (core, control, plug):
        await until(lambda: plug.refused)
        plug.plugged = True
        await until(lambda: core.drive("fan").status is not None)
        before = len(kinds(core))
        control.order("power", drive="fan", state="off")
        await until(lambda: core.drive("fan").reachability == "silent")
        assert kinds(core)[before:] == ["silent"]


class Pause:
    """Replacement for `Backoff` with almost no pause, which counts the failures of each series."""

    rows: ClassVar = []

    def __init__(self, *_):
        self.over_at = 0.0
        self.failures = 0
        self.rows.append(self)

    def failed(self, now_s):
        self.failures += 1
        self.over_at = now_s + 0.001


@awaited
async def test_pause_before_polling_restarts_after_a_period_without_failures(tmp_path, monkeypatch):
    monkeypatch.setattr(served_line, "Backoff", Pause)
    monkeypatch.setattr(Pause, "rows", [])
    monkeypatch.setattr(served_line, "REOPEN_LONGEST_S", 1000.0)
    async with served(tmp_path) as (core, _, _plug):
        await until(lambda: core.drive("fan").status is not None)
        line, taken, failing = core.lines["yard"], [], 0
        usual = line._take

        def take(result):
            nonlocal failing
            taken.append(result)
            if failing:
                failing -= 1
                raise RuntimeError("a mistake")
            usual(result)

        async def fail(times):
            nonlocal failing
            failing = times
            await until(lambda: not failing)
            taken.clear()
            await until(lambda: taken)

        def rows_of_polling():
            return [row.failures for row in Pause.rows if row.failures]

        monkeypatch.setattr(line, "_take", take)
        await fail(2)
        assert rows_of_polling() == [2]
        # From now on any period without a failure is long enough.
        monkeypatch.setattr(served_line, "REOPEN_LONGEST_S", -1.0)
        await fail(1)
        assert rows_of_polling() == [2, 1]


@awaited
async def test_values_of_every_quality_are_bad_when_polling_fails(tmp_path):
    async with served(tmp_path) as (core, _, _plug):
        await until(lambda: core.table.value("fan", "status"))
        await core.lines["yard"].pause()
        reading = Reading(parameter="16-13", value=Decimal(50), raw=500, time_s=1.0)
        for name, quality in (("16-13", "good"), ("16-14", "uncertain"), ("16-16", "stale")):
            core.table.put_value(
                CurrentValue(
                    drive="fan", name=name, reading=replace(reading, parameter=name), quality=quality, time_s=1.0
                )
            )
        core.lines["yard"]._lost("polling has failed")
        found = {each.name: (each.quality, each.reading) for each in core.table.values()}
        assert found == dict.fromkeys(("status", "16-13", "16-14", "16-16"), ("bad", None))
