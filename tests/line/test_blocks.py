"""Poll plans that read several parameters in one telegram: joined, split, and robust against a bad parameter."""

import asyncio
from itertools import pairwise

import pytest
from two_faces import each_face, open_on

import drivecomm
from drivecomm.errors import NoReplyError, RefusedError, UsageError
from drivecomm.line import STATUS, PollBlock, PollItem, Schedule, in_blocks, poll, poll_async
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.plant.watching import DriveView, TrackedDrive
from drivecomm.protocol import DriveConfig, Reading
from drivecomm.virtual import VirtualLine, virtual_drive

FACTS = {"baudrate": 19200}
REGISTERS = [f"{address}" for address in range(100, 140)]
SERIES = """
format = 1
protocol = "modbus"
name = "{name}"
title = "Mill drives"
source = "manual M-1 p. 3"
[options]
max_registers = {most}
[control]
start = [["1", 1]]
stop = [["1", 0]]
[control.status]
running = ["1", 1, 1]
"""


def model_of(folder, registers=REGISTERS, most=20, name="mill"):
    """Return the file of a series with these registers; each register holds its own number."""
    text = SERIES.format(name=name, most=most)
    for address in registers:
        text += (
            f'[[parameter]]\naddress = "{address}"\nname = "register_{address}"\naccess = "r"\nstart = "{address}"\n'
        )
    file = folder / f"{name}.toml"
    file.write_text(text)
    return str(file)


@pytest.fixture
def mill(tmp_path):
    return model_of(tmp_path)


def bus_with(model, *, trace=None, **line):
    line = VirtualLine([virtual_drive("modbus", 1, model=model, **FACTS)], **line)
    return line, drivecomm.open_bus(line.port, trace=trace)


def collect_sent(sent):
    return lambda event: sent.append(event) if event.what == "sent" else None


def plan(drive, parameters=REGISTERS, **facts):
    return [PollItem(drive=drive, parameter=each, **{"period_s": 0, **facts}) for each in parameters]


def seconds_a_round(model, *, together):
    line, bus = bus_with(model)
    with bus:
        # An item with options is read alone.
        options = {} if together else {"type": "u16"}
        drive = bus.drive("modbus", 1, model=model, **FACTS)
        results = list(poll(plan(drive, options=options), cycles=5))
        assert all(str(result.reading.value) == result.parameter for result in results)
        assert len(results) == 5 * len(REGISTERS)
        return line.time / 5


def test_forty_registers_are_read_five_times_as_fast_in_blocks(mill):
    assert 5 * seconds_a_round(mill, together=True) <= seconds_a_round(mill, together=False)


@each_face
def test_each_reading_of_a_block_has_the_time_of_its_telegram(face, mill):
    sent, line = [], VirtualLine([virtual_drive("modbus", 1, model=mill, **FACTS)])
    with open_on(face, line.port, trace=collect_sent(sent)) as bus:
        readings = bus.drive("modbus", 1, model=mill, **FACTS).read_many(REGISTERS)
    assert [reading.parameter for reading in readings] == REGISTERS
    assert len(sent) == 2
    times = sorted({reading.time_s for reading in readings})
    assert len(times) == 2
    assert sent[0].time < times[0] <= sent[1].time < times[1] <= line.time


def test_parameter_that_the_drive_lacks_does_not_affect_the_others(tmp_path):
    known = model_of(tmp_path)
    real = model_of(tmp_path, [each for each in REGISTERS if each != "113"], name="old")
    line = VirtualLine([virtual_drive("modbus", 1, model=real, **FACTS)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model=known, **FACTS)
        came = drive.read_many(REGISTERS)
        results = list(poll(plan(drive), cycles=3))
        alone = line.time
        list(poll(plan(drive), cycles=1))
    assert [type(each) for each in came] == [RefusedError if each == "113" else Reading for each in REGISTERS]
    assert {result.parameter for result in results if result.error} == {"113"}
    assert len(results) == 3 * len(REGISTERS)
    assert line.time > alone


def test_refused_block_is_read_in_parts_afterwards(tmp_path):
    known = model_of(tmp_path)
    real = model_of(tmp_path, [each for each in REGISTERS if each != "113"], name="old")
    sent = []
    line = VirtualLine([virtual_drive("modbus", 1, model=real, **FACTS)])
    with drivecomm.open_bus(line.port, trace=collect_sent(sent)) as bus:
        drive = bus.drive("modbus", 1, model=known, **FACTS)
        results = poll(plan(drive, period_s=1), cycles=3)
        rounds = [[next(results) for _ in REGISTERS] for _ in range(3)]
        telegrams = [event.time for event in sent]
    assert all(len(each) == len(REGISTERS) for each in rounds)
    after = [time for time in telegrams if 2 <= time < 3]
    assert len(after) < 10 < len([time for time in telegrams if time < 2])


def test_silent_drive_fails_each_item_of_a_block(mill):
    line, bus = bus_with(mill, faults=FaultPlan(rate=1.0, kinds=[LineFault.DROP]))
    with bus:
        drive = bus.drive("modbus", 1, model=mill, attempts=1, **FACTS)
        results = list(poll(plan(drive), cycles=1))
        with pytest.raises(NoReplyError):
            drive.read_many(REGISTERS)
    assert [result.quality for result in results] == ["bad"] * len(REGISTERS)
    assert {type(result.error) for result in results} == {NoReplyError}
    assert line.time > 0


def test_items_with_other_periods_priorities_or_options_are_not_joined(mill):
    _, bus = bus_with(mill)
    with bus:
        drive, other = (bus.drive("modbus", address, model=mill) for address in (1, 2))
        items = [
            *plan(drive, ["100", "101"], period_s=1),
            *plan(drive, ["102"], period_s=2),
            *plan(drive, ["103"], period_s=1, priority=1),
            *plan(drive, ["104"], period_s=1, options={"type": "s16"}),
            *plan(other, ["105"], period_s=1),
            *plan(drive, ["no register"], period_s=1),
            *plan(drive, ["110"], period_s=1),
        ]
        turns = in_blocks(items)
    assert [turn.parameters for turn in turns if isinstance(turn, PollBlock)] == [["100", "101"]]
    assert [turn.parameter for turn in turns if isinstance(turn, PollItem)] == [
        "102", "103", "104", "105", "no register", "110",
    ]  # fmt: skip


def test_drives_of_protocols_without_blocks_are_read_one_by_one():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model="act")
        assert all(isinstance(turn, PollItem) for turn in in_blocks(plan(drive, ["480", "481"])))
        assert [reading.parameter for reading in drive.read_many(["480", "output_frequency"])] == ["480", "210"]


@pytest.mark.parametrize(
    ("wanted", "why"), [("100", "not a list"), (["nonsense"], "an address"), (["1"] * 1001, "many")]
)
def test_read_many_refuses_invalid_lists_before_sending(wanted, why, mill):
    sent = []
    _, bus = bus_with(mill, trace=collect_sent(sent))
    with bus, pytest.raises(UsageError, match=why):
        bus.drive("modbus", 1, model=mill).read_many(wanted)
    assert not sent


def test_read_only_drive_is_read_in_blocks(mill):
    sent = []
    _, bus = bus_with(mill, trace=collect_sent(sent))
    with bus:
        bus.drive("modbus", 1, model=mill, read_only=True, **FACTS).read_many(REGISTERS)
    assert len(sent) == 2


def test_stop_waits_for_at_most_one_telegram_of_a_block_plan(mill):
    """A stop that is called while blocks are read waits only for the telegram under way."""
    sent = []
    line = VirtualLine([virtual_drive("modbus", 1, model=mill, **FACTS)])

    async def main():
        async with drivecomm.open_bus_async(line.port, trace=collect_sent(sent)) as bus:
            drive = bus.drive("modbus", 1, model=mill, **FACTS)
            reading = asyncio.create_task(drive.read_many(REGISTERS * 5))
            await asyncio.sleep(0)
            await asyncio.gather(drive.stop(), reading, return_exceptions=True)

    asyncio.run(main())
    assert any(event.data[1] == 0x10 for event in sent[:2])


class TestSchedule:
    """Blocks in the schedule."""

    def items(self, number):
        return tuple(PollItem(drive=PUMP, parameter=str(each), period_s=1.0) for each in range(number))

    def test_block_takes_turns_with_single_items(self):
        block, single = PollBlock(self.items(3)), PollItem(drive=PUMP, parameter="x", period_s=0.5)
        schedule = Schedule([block, single], start_s=0.0)
        now, turns = 0.0, []
        while (now := max(now, schedule.next_due())) < 5:
            turn = schedule.due(now)
            turns.append(turn)
            now += 0.01
            if turn is block:
                results = schedule.block_finished(block, now, [reading(now)] * 3, time_s=now)
                assert [result.item for result in results] == list(block.items)
                assert {result.late_s < 0.02 for result in results} == {True}
            else:
                schedule.finished(turn, now, reading(now), time_s=now)
        assert turns.count(block) == 5
        assert turns.count(single) == 10

    def test_halves_of_a_refused_block_are_due_immediately_and_keep_their_periods(self):
        block = PollBlock(self.items(5))
        schedule = Schedule([block], start_s=0.0, cycles=2)
        assert schedule.due(0.0) is block
        assert schedule.block_finished(block, 0.1, RefusedError("0", 2, "unknown"), time_s=0.1) == []
        seen = []
        while (due := schedule.next_due()) < 10:
            turn = schedule.due(max(due, 0.1))
            own = turn.items if isinstance(turn, PollBlock) else (turn,)
            seen.append((due, [each.parameter for each in own]))
            schedule.block_finished(turn, max(due, 0.1), [reading()] * len(own), time_s=0.0)
        assert seen == [(0.0, ["0", "1"]), (0.0, ["2", "3", "4"]), (1.0, ["0", "1"]), (1.0, ["2", "3", "4"])]
        assert all(first <= second for (first, _), (second, _) in pairwise(seen))

    def test_failed_block_gives_each_item_its_own_stale_value(self):
        block = PollBlock(self.items(2))
        schedule = Schedule([block], start_s=0.0)
        schedule.due(0.0)
        schedule.block_finished(block, 0.1, [reading(0.1, 1), reading(0.1, 2)], time_s=0.1)
        schedule.due(1.0)
        results = schedule.block_finished(block, 1.1, NoReplyError("nothing came"), time_s=1.1)
        assert [(result.quality, result.reading.value) for result in results] == [("stale", 1), ("stale", 2)]


class _Pump:
    name = "pump"


PUMP = _Pump()


def reading(time_s=0.0, value=5):
    return Reading(parameter="1", value=value, raw=value, time_s=time_s)


def test_seen_drive_reads_registers_in_blocks_and_its_status_alone(mill):
    sent = []
    line = VirtualLine([virtual_drive("modbus", 1, model=mill, **FACTS)])

    async def main():
        async with drivecomm.open_bus_async(line.port, trace=collect_sent(sent)) as bus:
            config = DriveConfig(protocol="modbus", address=1)
            seen = TrackedDrive(None, bus.drive("modbus", 1, model=mill, **FACTS), DriveView(drive=config, line="hall"))
            items = plan(seen, [*REGISTERS[:10], STATUS, *REGISTERS[10:20]])
            return [result async for result in poll_async(items, cycles=1)]

    results = asyncio.run(main())
    assert {result.parameter for result in results} == {*REGISTERS[:20], STATUS}
    assert all(result.quality != "bad" for result in results)
    assert len(sent) == 2


def test_drive_whose_package_fails_to_build_blocks_is_read_one_by_one(mill, monkeypatch, caplog):
    line = VirtualLine([virtual_drive("modbus", 1, model=mill, **FACTS)])

    def broken(*_):
        raise IndexError("a mistake")

    async def main():
        async with drivecomm.open_bus_async(line.port) as bus:
            drive = bus.drive("modbus", 1, model=mill, **FACTS)
            monkeypatch.setattr(type(drive), "blocks", broken)
            seen = TrackedDrive(None, drive, DriveView(drive=DriveConfig(protocol="modbus", address=1), line="hall"))
            return [result async for result in poll_async(plan(seen, REGISTERS[:3]), cycles=1)]

    assert [str(result.reading.value) for result in asyncio.run(main())] == REGISTERS[:3]
    assert "because of a mistake in its package" in caplog.text
