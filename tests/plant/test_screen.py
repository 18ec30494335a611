"""The screen of `drivecomm watch` and its keys, in a simulated terminal, over virtual plants."""

import asyncio
import contextlib
import re
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import pytest
from plants import FAN, PUMP, WELL, dark, plant_of, tripped, virtual_lines
from textual.widgets import DataTable, RichLog, Static

import drivecomm
import drivecomm.cli.watch.command as watching
from drivecomm.bus import AsyncDrive, set_watchdog
from drivecomm.cli import main
from drivecomm.cli.watch.log_switch import LogSwitch
from drivecomm.cli.watch.screen import WatchScreen
from drivecomm.cli.watch.screens import ConfirmationScreen
from drivecomm.cli.watch.words import event_line
from drivecomm.errors import PortError
from drivecomm.plant.value_log import read_rows
from drivecomm.plant.watching import DriveEvent, Watcher
from drivecomm.protocol import LinkLossPolicy, MachineUnit, Reading

NAMES = ["output_frequency", "output_current", "output_power"]


class ScreenUnderTest:
    """Watch screen that has shown a plant for some seconds, with keys to press."""

    def __init__(self, screen, pilot, plant):
        self.screen = screen
        self.pilot = pilot
        self.plant = plant

    async def press(self, *keys):
        await self.pilot.press(*keys)
        await self.pilot.pause()
        await self.screen.workers.wait_for_complete()
        await self.pilot.pause()

    @property
    def message(self):
        return str(self.screen.screen_stack[0].query_one("#message", Static).content)

    @property
    def text(self):
        """Lines of text on the screen."""
        return [
            "".join(segment.text for segment in strip).rstrip()
            for strip in self.screen.screen._compositor.render_strips()
        ]

    def row(self, drive):
        (line,) = [line for line in self.text if re.match(rf" {drive} ", line)][:1]
        return line

    def running(self, drive):
        return next(state.running for state in self.plant.states() if state.name == drive)


@asynccontextmanager
async def watched(plant, *, size=(100, 30), seconds=3, log=None, arm=False, names=None, **changes):
    chosen = {"names": names} if names else {}
    watcher = Watcher(virtual_lines(plant, **changes), **chosen)
    switch = LogSwitch(log)
    watcher.told = switch.tell
    screen = WatchScreen(watcher, title="plant.toml", log=switch, armed=arm, duration_s=seconds)
    async with screen.run_test(size=size) as pilot:
        await screen.asked_all.wait()
        screen.show()
        await pilot.pause()
        yield ScreenUnderTest(screen, pilot, plant)
    switch.close()
    assert not any(line.is_open for line in watcher._lines)


def started(plant, *names):
    for name in names:
        planned = plant.drive(name).planned
        with drivecomm.open_bus(plant.line(planned.line).port) as bus:
            drive = bus.drive(planned.protocol, planned.address, **planned.options)
            drive.set_reference(percent=50) if planned.protocol == "danfoss-fc" else drive.set_reference(hz=25)
            drive.start()
    return plant


def run(scene):
    return asyncio.run(scene)


@pytest.mark.soak
def test_table_shows_states_values_faults_and_events():
    async def scene():
        plant = started(plant_of(PUMP, FAN, WELL, script=[tripped("fan", 14, 1), dark("well", 1)]), "pump")
        async with watched(plant, seconds=8) as watch:
            assert "plant.toml  3 drives, 1 fault, 1 silent" in watch.text[0]
            assert re.search(r"log off  00:00:0[78]$", watch.text[0])
            assert re.search(r"running +25\.00", watch.row("pump"))
            assert "FAULT" in watch.row("fan")
            assert "14 earth fault" in watch.row("fan")
            assert "no answer" in watch.row("well")
            assert "silent for" in watch.row("well")
            assert "█" in watch.row("pump")
            happened = [line for line in watch.text if re.match(r" 00:00:0\d  ", line)]
            assert any("fan  fault: 14 earth fault" in line for line in happened)
            assert any("well  did not answer" in line for line in happened)
            assert watch.message == "asked for 8 s; q quits"

    run(scene())


def test_machine_speed_is_shown_beside_the_frequency():
    async def scene():
        machine = MachineUnit(unit="m/min", per_hz="1.25")
        plant = started(plant_of(replace(PUMP, machine=machine), FAN), "pump")
        async with watched(plant, seconds=10, names=NAMES) as watch:
            assert re.search(r"running +25\.00 +31\.25 m/min", watch.row("pump"))
            assert "m/min" not in watch.row("fan")
            assert sum("31.25 m/min" in line for line in watch.text) == 2

    run(scene())


@pytest.mark.soak
@pytest.mark.parametrize(
    ("width", "there", "not_there"),
    [
        (20, ["drive"], ["note"]),
        (40, ["drive", "state", "note"], ["trend", "curr A"]),
        (80, ["drive", "state", "freq Hz", "trend", "note"], ["address", "asked"]),
        (160, ["address", "curr A", "power kW", "asked", "lost", "age s"], []),
    ],
)
def test_columns_depend_on_the_terminal_width(width, there, not_there):
    async def scene():
        async with watched(plant_of(PUMP, FAN), size=(width, 24), names=NAMES) as watch:
            head = watch.text[1]
            assert [word for word in there if word not in head] == []
            assert [word for word in not_there if word in head] == []
            assert all(len(line) <= width for line in watch.text)
            await watch.pilot.resize_terminal(160, 50)
            await watch.pilot.pause()
            await watch.pilot.pause()
            assert "address" in watch.text[1]

    run(scene())


@pytest.mark.soak
@pytest.mark.parametrize(("width", "note"), [(30, 0), (36, 0), (40, 9), (48, 17), (60, 18)])
def test_note_is_shortened_before_the_name_in_a_narrow_terminal(width, note):
    long = replace(PUMP, name="a pump with a long name")

    async def scene():
        async with watched(plant_of(long, script=[dark("a pump with a long name", 1)]), size=(width, 24)) as watch:
            assert watch.text[1].startswith(" drive ")
            assert "state" in watch.text[1]
            assert ("note" in watch.text[1]) == bool(note)
            row = watch.text[2]
            assert row.startswith(" a pump with a lo")
            assert "no answer" in row
            assert "silent for 3 s"[:note].strip() in row

    run(scene())


@pytest.mark.soak
@pytest.mark.parametrize(("width", "there"), [(40, []), (56, ["trend"]), (100, ["trend", "range"])])
def test_values_of_a_drive_are_not_cut_off_in_a_narrow_terminal(width, there):
    async def scene():
        async with watched(started(plant_of(PUMP), "pump"), size=(width, 24), seconds=8) as watch:
            (row,) = [line for line in watch.text if line.startswith(" output frequency")]
            assert re.match(r" output frequency +25\.00 Hz", row)
            assert ("█" in row) == ("trend" in there)
            assert row.endswith(" to 25 Hz") == ("range" in there)

    run(scene())


@pytest.mark.soak
def test_message_disappears_after_a_while(monkeypatch):
    monkeypatch.setattr("drivecomm.cli.watch.screen.SAID_S", 0.05)

    async def scene():
        async with watched(plant_of(PUMP)) as watch:
            watch.screen.say("said before")
            watch.screen.say("nothing was sent")
            assert watch.message == "nothing was sent"
            for _ in range(100):
                await asyncio.sleep(0.02)
                if watch.message != "nothing was sent":
                    break
            assert watch.message == "asked for 3 s; q quits", "what holds on is said again"

    run(scene())


def test_event_shows_the_time_of_day_if_it_is_known():
    event = DriveEvent(time_s=3661.0, drive="pump", kind="change", text="running")
    assert event_line(event, None).plain == "01:01:01  pump  running"
    noon = datetime(2026, 5, 4, 12, 0, 0).astimezone().timestamp()
    assert event_line(event, noon).plain == "13:01:01  pump  running"


@pytest.mark.soak
def test_panel_follows_the_cursor_and_the_v_key_changes_the_trend():
    async def scene():
        async with watched(plant_of(PUMP, FAN), size=(140, 40), names=NAMES) as watch:
            assert any(line.startswith(" pump  vabus:1 on hall, agile, read-only:") for line in watch.text)
            await watch.press("down")
            assert any(line.startswith(" fan  danfoss-fc:3 on hall, fc300, read-only:") for line in watch.text)
            await watch.press("up")
            assert "freq Hz trend" in watch.text[1]
            assert any(line.startswith(" freq Hz, the last 60 s") for line in watch.text)
            await watch.press("v")
            assert "curr A trend" in watch.text[1]
            assert any(line.startswith(" curr A, the last 60 s") for line in watch.text)
            await watch.press("v", "v")
            assert "freq Hz trend" in watch.text[1]

    run(scene())


@pytest.mark.soak
def test_parameters_are_read_page_by_page():
    async def scene():
        async with watched(plant_of(PUMP), size=(100, 12)) as watch:
            before = watch.screen.watcher.board().view("pump").counters["requests"]
            await watch.press("enter")
            rows = 12 - 4
            assert re.match(r" pump: .*page 1 of \d+", watch.text[0])
            assert not any("..." in line for line in watch.text)
            first = list(watch.screen.watcher.drive("pump").model.parameters.values())[:rows]
            for info, line in zip(first, watch.text[2:], strict=False):
                assert line.split()[:2] == [info.address, info.name]
            asked = watch.screen.watcher.board().view("pump").counters["requests"] - before
            assert 0 < asked <= 2 * rows
            await watch.press("n")
            assert "page 2 of" in watch.text[0]
            await watch.press("b", "b")
            assert "page 1 of" in watch.text[0]
            again = watch.screen.watcher.board().view("pump").counters["requests"]
            await watch.press("r")
            assert watch.screen.watcher.board().view("pump").counters["requests"] > again
            await watch.press("escape")
            assert "plant.toml" in watch.text[0]

    run(scene())


@pytest.mark.soak
def test_parameters_are_shown_with_their_units():
    async def scene():
        plant = plant_of(PUMP)
        plant.set("pump", "480", 2000)
        async with watched(plant, size=(120, 60)) as watch:
            await watch.press("p")
            page = "\n".join(watch.text)
            while "480" not in page.split():
                await watch.press("n")
                page = "\n".join(watch.text)
            (line,) = [line for line in watch.text if line.startswith(" 480 ")]
            assert "20.00 Hz" in line

    run(scene())


@pytest.mark.parametrize("key", ["p", "escape"])
def test_parameters_screen_may_be_left_while_a_parameter_is_read(key, monkeypatch):
    async def scene():
        async with watched(plant_of(PUMP)) as watch:
            asked, answered = asyncio.Event(), asyncio.Event()

            async def polled(_, parameter):
                asked.set()
                # The reply arrives in the same loop step that cancels the read.
                with contextlib.suppress(asyncio.CancelledError):
                    await answered.wait()
                return Reading(parameter=parameter, value=1, raw=1)

            monkeypatch.setattr(AsyncDrive, "polled", polled)
            await watch.pilot.press("p")
            await asked.wait()
            await watch.pilot.press(key)
            answered.set()
            await watch.screen.workers.wait_for_complete()
            await watch.pilot.pause()
            assert "plant.toml" in watch.text[0]
            assert watch.screen.return_code in (None, 0)

    run(scene())


def test_crash_of_the_screen_exits_with_1(monkeypatch):
    screen = SimpleNamespace(run=lambda: None, return_code=1)
    monkeypatch.setattr(watching, "_screen", lambda: lambda *_, **__: screen)
    monkeypatch.setattr(watching, "_must_be_a_terminal", lambda: None)
    assert main(["watch", "vabus:1", "--port", "line"]) == 1


@pytest.mark.soak
def test_drive_without_a_model_has_no_parameters_to_show():
    async def scene():
        async with watched(plant_of(replace(PUMP, options={}))) as watch:
            await watch.press("p")
            assert "pump: no parameters are known" in watch.text[0]
            assert any("name a model" in line for line in watch.text)
            await watch.press("n", "r", "b")
            await watch.press("escape")

    run(scene())


@pytest.mark.soak
def test_trace_screen_shows_and_pauses_the_telegrams_of_a_drive():
    async def scene():
        async with watched(plant_of(PUMP, FAN), size=(120, 40), seconds=1) as watch:
            await watch.press("down", "t")
            assert watch.text[0].strip() == "telegrams with fan"
            log = watch.screen.screen.query_one(RichLog)
            lines = [strip.text for strip in log.lines]
            assert any(" ->  02 06 83 " in line for line in lines)
            assert any("status_word=0x" in line for line in lines)
            assert all(len(line) <= 116 for line in lines)
            await watch.press("space")
            await watch.screen.watcher.drive("fan").status()
            watch.screen.screen.show()
            assert "held still" in watch.text[0]
            assert len(log.lines) == len(lines)
            await watch.press("space")
            assert len(log.lines) > len(lines)
            await watch.press("t")
            assert "plant.toml" in watch.text[0]

    run(scene())


@pytest.mark.soak
def test_stop_key_asks_for_confirmation():
    async def scene():
        async with watched(started(plant_of(PUMP, FAN), "pump", "fan")) as watch:
            for answer in ("n", "escape", "enter"):
                await watch.press("s")
                assert isinstance(watch.screen.screen, ConfirmationScreen)
                assert any("Stop pump?" in line for line in watch.text)
                await watch.press(answer)
                assert watch.message == "nothing was sent"
            assert watch.running("pump")
            await watch.press("s", "y")
            assert watch.message == "pump stopped"
            watch.plant.line("hall").advance(30)
            assert not watch.running("pump")
            assert watch.running("fan")
            assert any("pump  stopped from here" in line for line in watch.text)

    run(scene())


@pytest.mark.soak
def test_capital_s_key_stops_without_confirmation():
    async def scene():
        async with watched(started(plant_of(PUMP, FAN), "pump", "fan")) as watch:
            await watch.press("down", "S")
            assert watch.message == "fan stopped"
            watch.plant.line("hall").advance(30)
            assert not watch.running("fan")
            assert watch.running("pump")

    run(scene())


@pytest.mark.soak
@pytest.mark.parametrize("key", ["p", "t"])
def test_capital_s_key_stops_from_every_screen_except_a_confirmation(key):
    async def scene():
        async with watched(started(plant_of(PUMP, FAN), "fan")) as watch:
            await watch.press("down", "s", "S")
            assert watch.message != "fan stopped"
            await watch.press("n", key, "S")
            assert watch.message == "fan stopped"
            assert watch.screen.screen is not watch.screen.screen_stack[0]
            watch.plant.line("hall").advance(30)
            assert not watch.running("fan")

    run(scene())


@pytest.mark.soak
def test_failed_stop_is_reported():
    async def scene():
        async with watched(plant_of(PUMP, script=[dark("pump", 1)])) as watch:
            await watch.press("S")
            assert watch.message.startswith("not stopped: ")
            assert any("pump  not stopped: " in line for line in watch.text)

    run(scene())


@pytest.mark.soak
@pytest.mark.parametrize(
    ("key", "arm", "changes", "why"),
    [
        (
            "g",
            False,
            {"armed": True, "link_loss": LinkLossPolicy(policy="hold")},
            "pump is not commanded: watch was started without --arm",
        ),
        ("r", False, {"armed": True}, "pump is not commanded: watch was started without --arm"),
        ("g", True, {}, "pump is read-only: write armed = true for it in the plant file"),
        ("r", True, {}, "pump is read-only: write armed = true for it in the plant file"),
        ("g", True, {"armed": True}, "pump is not started: the plant file has no link_loss, "),
        (
            "g",
            True,
            {"armed": True, "link_loss": LinkLossPolicy(policy="ramp")},
            "use drivecomm start pump --link-loss ramp",
        ),
    ],
)
def test_drive_that_may_not_be_commanded_gets_nothing_and_shows_why(key, arm, changes, why):
    async def scene():
        plant = plant_of(PUMP)
        async with watched(plant, arm=arm, **changes) as watch:
            before = watch.screen.watcher.board().view("pump").counters["requests"]
            await watch.press(key)
            assert why in watch.message
            assert not isinstance(watch.screen.screen, ConfirmationScreen)
            assert watch.screen.watcher.board().view("pump").counters["requests"] == before
            assert not watch.running("pump")

    run(scene())


@pytest.mark.soak
def test_armed_drive_is_started_and_reset_after_confirmation():
    async def scene():
        plant = plant_of(FAN, script=[tripped("fan", 14, 1)])
        async with watched(plant, arm=True, armed=True, link_loss=LinkLossPolicy(policy="hold")) as watch:
            assert watch.screen.watcher.board().view("fan").fault
            await watch.press("r")
            assert any("its fault: 14 earth fault" in line for line in watch.text)
            await watch.press("y")
            assert watch.message == "fan reset"
            assert not (await watch.screen.watcher.drive("fan").status()).fault
            await watch.press("g")
            assert any("Start fan?" in line for line in watch.text)
            await watch.press("n")
            assert not watch.running("fan")
            await watch.press("g", "y")
            assert watch.message == "fan started"
            assert watch.running("fan")

    run(scene())


@pytest.mark.soak
def test_drive_with_its_watchdog_on_is_not_started_with_hold():
    async def scene():
        plant = plant_of(FAN)
        with drivecomm.open_bus(plant.line("hall").port) as bus:
            set_watchdog(bus.drive("danfoss-fc", 3, model="fc300"), "ramp", 5)
        async with watched(plant, arm=True, armed=True, link_loss=LinkLossPolicy(policy="hold")) as watch:
            await watch.press("g", "y")
            assert watch.message.startswith("not started: ")
            assert "watchdog" in watch.message
            assert not watch.running("fan")

    run(scene())


@pytest.mark.soak
def test_log_key_starts_and_pauses_a_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    async def scene():
        async with watched(plant_of(PUMP)) as watch:
            await watch.press("l")
            assert re.fullmatch(r"logging to watch-\d{8}-\d{6}\.csv", watch.message)
            assert ".csv  00:00:0" in watch.text[0]
            await watch.screen.watcher.run(duration_s=3)
            await watch.press("l")
            assert "logging is paused" in watch.message
            assert "log paused" in watch.text[0]
            await watch.screen.watcher.run(duration_s=3)

    run(scene())
    (path,) = tmp_path.iterdir()
    rows = list(read_rows(path))
    assert len(rows) == 12
    assert {row.name for row in rows} == {"status", "output_frequency", "output_current", "output_power"}


@pytest.mark.soak
def test_unwritable_log_is_reported(tmp_path):
    async def scene():
        async with watched(plant_of(PUMP), log=tmp_path / "nowhere" / "log.csv") as watch:
            await watch.press("l")
            assert "cannot be written as a log" in watch.message
            assert "log off" in watch.text[0]

    run(scene())


@pytest.mark.soak
def test_full_disk_is_reported_and_the_log_continues_later(tmp_path):
    async def scene():
        async with watched(plant_of(PUMP), log=tmp_path / "log.csv") as watch:
            await watch.press("l")

            def full(_):
                raise OSError(28, "No space left on device")

            rows = watch.screen._value_log._log._rows
            write, rows.write = rows.write, full
            await watch.screen.watcher.run(duration_s=2)
            watch.screen.show()
            await watch.pilot.pause()
            assert re.search(
                r"log.csv: no space left on the device; values are not logged from [\d:]{8} on; polling continues",
                watch.message,
            )
            assert watch.text[0].endswith("log log.csv, 8 missing  00:00:04")
            assert watch.screen.watcher.board().view("pump").reachability == "answers"
            rows.write = write
            await watch.screen.watcher.run(duration_s=6)
            assert re.search(r"values are logged again from \d\d:\d\d:\d\d on; \d\d are missing$", watch.message)

    run(scene())
    assert list(read_rows(tmp_path / "log.csv"))


def test_screen_ends_if_its_line_cannot_be_opened():
    def broken():
        raise PortError("port hall does not exist; plug the adapter in")

    async def scene():
        lines = [replace(line, port=broken) for line in virtual_lines(plant_of(PUMP))]
        screen = WatchScreen(Watcher(lines), title="plant.toml", log=LogSwitch(None))
        async with screen.run_test() as pilot:
            await pilot.pause()
            for _ in range(50):
                if screen.return_value is not None:
                    break
                await asyncio.sleep(0.02)
        assert isinstance(screen.return_value, PortError)

    run(scene())


@pytest.mark.soak
def test_q_key_quits():
    async def scene():
        async with watched(plant_of(PUMP)) as watch:
            await watch.pilot.press("q")
            await watch.pilot.pause()
            assert watch.screen.return_value is None
            assert not watch.screen.is_running or watch.screen._exit

    run(scene())


@pytest.mark.soak
def test_sixty_drives_are_scrolled_through():
    drives = [
        replace(PUMP, address=1 + number % 30, line=["hall", "yard"][number // 30], name=f"drive{number:02}")
        for number in range(60)
    ]

    async def scene():
        async with watched(plant_of(*drives), seconds=1, size=(80, 24), names=["output_frequency"]) as watch:
            assert "plant.toml  60 drives" in watch.text[0]
            await watch.press("ctrl+end")
            table = watch.screen.query_one("#drives", DataTable)
            assert table.cursor_row == 59
            assert any(line.startswith(" drive59  vabus:30 on yard") for line in watch.text)

    run(scene())
