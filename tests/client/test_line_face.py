"""The declared interface of a line, and the buses that offer it."""

import asyncio
from inspect import signature

import pytest
from running_server import running_server

import drivecomm
from drivecomm.bus import AsyncBroadcast, AsyncBus, AsyncDrive, AwaitedLine, BlockingLine, Broadcast, Bus, Drive
from drivecomm.client import AsyncServedBus, ServedBus
from drivecomm.line import PollItem
from drivecomm.plant import async_bus_of_server, read_plant
from drivecomm.plant.watching import Watcher, lines_of
from drivecomm.protocol import DriveState, Stop

OF_A_PORT = {"lend", "listen", "member", "on_engine", "questions", "run", "scan"}
HERE = {"all_made_here", "at_server", "made_here", "on_this_line"}
OF_A_SERVER = HERE | {"carry_out", "count_from_now", "described", "drives", "names", "sent", "settings"}
OF_USE = {
    "broadcast", "close", "counters", "drive", "health", "listen", "now", "other_master", "poll", "real_time", "scan",
    "sleep_until", "statistics", "stop_all",
}  # fmt: skip
BUSES = [
    pytest.param(BlockingLine, Bus, OF_A_PORT - {"listen", "scan"}, id="Bus"),
    pytest.param(BlockingLine, ServedBus, OF_A_SERVER, id="ServedBus"),
    pytest.param(AwaitedLine, AsyncBus, OF_A_PORT | {"health", "other_master"}, id="AsyncBus"),
    pytest.param(AwaitedLine, AsyncServedBus, OF_A_SERVER - {"count_from_now"}, id="AsyncServedBus"),
]


def public(kind):
    return {name for name in dir(kind) if not name.startswith("_")}


def arguments(kind, name):
    return [(each.name, each.kind) for each in signature(getattr(kind, name)).parameters.values()]


async def until(condition):
    async with asyncio.timeout(10.0):
        while not condition():  # noqa: ASYNC110 - the condition sets no event
            await asyncio.sleep(0.01)


@pytest.mark.parametrize(("face", "bus", "own"), BUSES)
def test_public_names_of_a_bus_are_its_interface_and_known_extras(face, bus, own):
    assert public(bus) == public(face) | own


@pytest.mark.parametrize(("face", "bus", "own"), BUSES)
def test_methods_of_a_bus_take_the_arguments_of_the_interface(face, bus, own):
    for name in public(face) - own:
        if callable(getattr(face, name)):
            assert arguments(bus, name) == arguments(face, name), name


def test_drives_of_a_served_line_are_instances_of_drive(plant):
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        line = opened.bus("hall")
        assert isinstance(line, ServedBus)
        assert repr(line).startswith("<ServedBus line hall of drivecomm serve")
        assert repr(line).endswith(", 2 drives>")
        assert isinstance(opened.drive("pump"), Drive)
        assert isinstance(line.broadcast("vabus"), Broadcast)


def test_dir_of_a_served_drive_and_line_lists_only_public_names(plant):
    async def of_awaited():
        (line,) = read_plant(plant).lines
        async with async_bus_of_server(line.reached_at) as bus:
            return public(bus), public(bus.drive("vabus", 1, model="agile"))

    with running_server(plant), drivecomm.open_plant(plant) as opened:
        line, pump = opened.bus("hall"), opened.drive("pump")
        lines, drives = (public(line), asyncio.run(of_awaited())[0]), (public(pump), asyncio.run(of_awaited())[1])
        everybody = public(line.broadcast("vabus"))
    for each in lines:
        assert each - OF_USE == {"drives", "names", "port", "server", "settings"} | (each & {"count_from_now", "line"})
    for each in drives:
        assert each & (OF_A_SERVER | {"place", "send", "request", "own_error", "feeding", "polled", "peer"}) == set()
        assert {"read", "stop", "parameters", "lease", "server"} <= each
    assert everybody == {"capabilities", "stop", "write"}


def test_served_stop_all_takes_the_kind_of_stop_as_text(plant):
    async def stopped():
        (line,) = read_plant(plant).lines
        async with async_bus_of_server(line.reached_at) as bus:
            return await bus.stop_all("coast")

    with running_server(plant), drivecomm.open_plant(plant) as opened:
        results = [opened.bus("hall").stop_all("coast"), opened.stop_all("coast"), asyncio.run(stopped())]
        with pytest.raises(drivecomm.UsageError, match="did you mean 'coast'"):
            opened.bus("hall").stop_all("caost")
        with pytest.raises(drivecomm.UsageError, match="did you mean 'coast'"):
            opened.stop_all("caost")
        assert opened.drive("pump").wait_for("not_ready").state is DriveState.NOT_READY
        with pytest.raises(drivecomm.UsageError, match="write percent=50"):
            opened.drive("pump").set_reference(50)
    for each in results:
        assert {one.how for one in each if not one.error} == {Stop.COAST}


def test_awaited_served_line_polls_counts_and_broadcasts(plant):
    async def used():
        (line,) = read_plant(plant).lines
        async with async_bus_of_server(line.reached_at) as bus:
            pump, everybody = bus.drive("vabus", 1, model="agile"), bus.broadcast("vabus")
            assert isinstance(pump, AsyncDrive)
            assert isinstance(everybody, AsyncBroadcast)
            items = [PollItem(drive=pump, parameter="480", period_s=0.0)]
            qualities = [each.quality async for each in bus.poll(items, cycles=2)]
            await pump.set_reference(percent=5)
            await pump.start()
            await everybody.stop(Stop.COAST)
            status = await pump.wait_for(DriveState.NOT_READY, 5.0)
            await until(lambda: "vabus:1" in bus.counters)
            return qualities, status.running

    with running_server(plant):
        assert asyncio.run(used()) == (["good", "good"], False)


def test_awaited_served_line_refuses_a_poll_of_a_drive_on_another_bus(plant):
    async def used():
        (line,) = read_plant(plant).lines
        async with async_bus_of_server(line.reached_at) as bus, async_bus_of_server(line.reached_at) as other:
            bus.poll([PollItem(drive=other.drive("vabus", 1, model="agile"), parameter="480", period_s=1.0)])

    with running_server(plant), pytest.raises(drivecomm.UsageError, match="not on this bus"):
        asyncio.run(used())


def test_watcher_of_a_served_line_knows_the_state_of_each_drive(plant):
    async def watched():
        async with Watcher(lines_of(read_plant(plant)), names=["output_frequency"], period_s=0.05) as watcher:
            watching = asyncio.create_task(watcher.run())
            await until(lambda: all(each.status for each in watcher.board().drives))
            watching.cancel()
            return [each.error for each in watcher.board().drives]

    with running_server(plant):
        assert asyncio.run(watched()) == ["", ""]
