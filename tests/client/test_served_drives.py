"""Drives through a server from Python: the same methods, results and errors as on a bus with its own port."""

import asyncio
import time
from contextlib import closing
from decimal import Decimal

import pytest
from fake_server import serving
from running_server import running_server

import drivecomm
from drivecomm.bus import read_watchdog, set_watchdog, set_watchdog_async
from drivecomm.client import LocalServer, error_content, error_of, json_text, parsed, server_of_plant
from drivecomm.errors import (
    DriveCommError,
    NotSupported,
    ParameterAddressError,
    PortError,
    ReadOnlyError,
    ServerLostError,
    StateError,
    UsageError,
    ValueRefusedError,
    WrongDriveError,
)
from drivecomm.line import PollItem
from drivecomm.plant.watching import Watcher, lines_of
from drivecomm.protocol import DriveState


@pytest.mark.soak
def test_served_drives_return_the_same_results_as_drives_at_a_port(plant):
    def carried_out(own_ports):
        with drivecomm.open_plant(plant, own_ports=own_ports) as opened:
            pump, fan = opened.drive("pump"), opened.drive("fan")
            pump.write("480", Decimal("12.50"))
            readings = [pump.read("480"), pump.read("output_frequency"), fan.read("3-03"), fan.polled("16-13")]
            identity = dict(pump.identify())
            pump.set_reference(percent=50.5)
            pump.start()
            running = pump.wait_for(DriveState.RUNNING, 3.0)
            pump.stop("coast")
            told = [(each.parameter, repr(each.value), each.raw, each.unit, each.note) for each in readings]
            return told, identity, running.state, fan.status().word, pump.capabilities, fan.facts, pump.model.name

    bare = carried_out(own_ports=True)
    with running_server(plant):
        assert carried_out(own_ports=False) == bare
        with pytest.raises(PortError, match="in use"):
            carried_out(own_ports=True)


def test_plant_that_requires_its_server_opens_no_port(plant):
    with pytest.raises(UsageError, match="exclude each other"):
        drivecomm.open_plant(plant, server=True, own_ports=True)
    with running_server(plant), drivecomm.open_plant(plant, server=True) as opened:
        pump = opened.drive("pump")
        assert pump.status().state
    with drivecomm.open_plant(plant, server=True) as opened, pytest.raises(PortError, match="start drivecomm serve"):
        opened.drive("pump")


def test_plant_that_requires_its_server_opens_no_port_after_the_server_dies(plant):
    with drivecomm.open_plant(plant, server=True) as opened:
        with running_server(plant):
            pump, fan = opened.drive("pump"), opened.drive("fan")
            assert pump.status().state
        for call in (pump.status, pump.start, pump.stop, fan.status, opened.drive("fan").stop):
            with pytest.raises(ServerLostError):
                call()
        assert {type(each.error) for each in opened.stop_all()} == {ServerLostError}
        with running_server(plant):
            assert pump.status().state
    with drivecomm.open_plant(plant, server=True) as opened:
        assert {type(each.error) for each in opened.stop_all()} == {PortError}


@pytest.mark.soak
def test_served_drives_raise_the_same_errors_as_drives_at_a_port(plant):
    def refused(call):
        try:
            call()
        except DriveCommError as error:
            return type(error), str(error)
        raise AssertionError

    no_number = object()

    def errors(own_ports):
        with drivecomm.open_plant(plant, own_ports=own_ports, attempts=1, reply_timeout_s=0.05) as opened:
            pump, fan, bus = opened.drive("pump"), opened.drive("fan"), opened.bus("hall")
            yield refused(lambda: pump.read("nonsense"))
            yield refused(lambda: pump.read("480", dataset="x"))
            yield refused(lambda: pump.read(480))
            yield refused(lambda: pump.read("99999"))
            yield refused(lambda: pump.write("480", no_number))
            yield refused(lambda: pump.write("480", float("nan")))
            yield refused(lambda: pump.write("480", "ten"))
            yield refused(lambda: pump.set_reference(percent=1, hz=2))
            yield refused(pump.jog)
            yield refused(lambda: pump.call("fly"))
            yield refused(lambda: pump.stop("gently"))
            yield refused(lambda: fan.write("3-03", 1))
            yield refused(fan.start)
            yield refused(lambda: fan.call("jog", number=1))
            yield refused(lambda: pump.wait_for("at_reference", 0.1))
            yield refused(lambda: pump.wait_for("soon"))
            yield refused(lambda: bus.drive("vabus", 9).read("480"))
            yield refused(lambda: bus.drive("vabus", 99))
            yield refused(lambda: bus.drive("vabus", 1, model="none"))
            yield refused(lambda: bus.drive("vabus", 1, colour="blue"))
            yield refused(lambda: bus.drive("profibus", 1))
            yield refused(lambda: opened.drive("pomp"))

    bare = [*errors(own_ports=True)]
    with running_server(plant):
        served = [*errors(own_ports=False)]
    assert served == bare
    kinds = {kind for kind, _ in bare}
    assert {ParameterAddressError, ValueRefusedError, NotSupported, ReadOnlyError, StateError} <= kinds


def test_served_line_is_polled_and_counted(plant):
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        items = [PollItem(drive=opened.drive("pump"), parameter="480", period_s=0.02)]
        items += [PollItem(drive=opened.drive("fan"), parameter="3-03", period_s=0.02)]
        results = [*opened.bus("hall").poll(items, cycles=3)]
        assert [each.quality for each in results if each.drive == "vabus:1"] == ["good"] * 3
        assert len(results) == 6
        assert opened.bus("hall").statistics["vabus:1"].counters["replies"] >= 3
        assert not opened.bus("hall").health["vabus:1"].given_up


def test_drive_made_read_only_by_the_program_sends_only_stops(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        pump = opened.bus("hall").drive("vabus", 1, model="agile", read_only=True)
        pump.read_only_reason = "not today"
        for command in (pump.start, pump.reset, lambda: pump.write("480", 1), lambda: pump.call("jog")):
            with pytest.raises(DriveCommError):
                command()
        with pytest.raises(ReadOnlyError, match="not today"):
            pump.start()
        pump.stop()
        assert [path.rpartition("/")[2] for _, path, _ in server.requests] == ["stop"]


def test_only_the_given_options_of_a_drive_are_sent_to_the_server(plant):
    with serving(plant) as server, drivecomm.open_plant(plant, attempts=2) as opened:
        opened.drive("pump").read("480")
        opened.bus("hall").drive("vabus", 1, model="agile").read("480")
        opened.drive("fan").read("3-03")
        bodies = [body for _, _, body in server.requests]
    assert [body.get("options") for body in bodies] == [{"attempts": 2}] * 3
    assert [body.get("arm") for body in bodies] == [None, None, None]


def test_read_is_repeated_after_a_lost_answer_and_a_command_is_not(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        pump = opened.drive("pump")
        pump.read("480")
        server.drops = 1
        assert pump.read("480").value == 30
        server.drops = 1
        with pytest.raises(ServerLostError, match="has gone"):
            pump.reset()
        assert [path.rpartition("/")[2] for _, path, _ in server.requests].count("reset") == 1


def test_request_that_times_out_is_not_repeated(plant):
    """The server has received the request and still works on it; a repetition would only slow it down further."""
    with serving(plant) as server:
        local = LocalServer(server_of_plant(plant))
        local.ask("/api/v1/drives")
        server.requests.clear()
        server.takes_s = 0.5
        with closing(local), pytest.raises(ServerLostError, match=r"no answer within 0.1 s"):
            local.ask("/api/v1/drives", limit_s=0.1)
        assert [path for _, path, _ in server.requests] == ["/api/v1/drives"]


def test_command_carries_its_time_and_its_validity(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        opened.drive("pump").reset()
        ((_, _, body),) = server.requests
    assert abs(time.time() - float(body["issued_s"])) < 5
    assert 0 < body["valid_s"] <= 10


@pytest.mark.soak
def test_hanging_server_raises_server_lost_error(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        pump = opened.drive("pump")
        pump.read("480")
        server.hang.set()
        with pytest.raises(ServerLostError, match=r"plant.toml \(pid \d+\) does not answer"):
            pump.read("480")
        server.hang.clear()
        assert pump.read("480").value == 30


@pytest.mark.soak
def test_client_waits_for_a_slow_server(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        server.takes_s = 3.0
        assert opened.drive("pump").read("480").value == 30


def test_options_that_no_server_accepts_are_refused(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        bus = opened.bus("hall")
        pump = bus.drive("vabus", 1)
        for refused in (
            lambda: bus.drive("vabus", 1, set_up={"413": 1}),
            lambda: pump.write("480", "1", store={}),
        ):
            with pytest.raises(UsageError):
                refused()
        assert server.requests == []
    with pytest.raises(UsageError, match="closed"):
        bus.now()


def test_decimals_keep_their_digits_in_json():
    for text in ("10.00", "50", "1E+3", "-0.1", "0"):
        assert str(parsed(json_text(Decimal(text)))) == text
        assert isinstance(parsed(json_text(Decimal(text))), Decimal)
    assert parsed(json_text([1, 0.5, "x"])) == [1, Decimal("0.5"), "x"]


@pytest.mark.soak
def test_watcher_reads_and_stops_through_a_server(plant):
    async def watched():
        async with Watcher(
            lines_of(drivecomm.plant.read_plant(plant)), names=["output_frequency"], period_s=0.05
        ) as one:
            await one.run(duration_s=0.5)
            await one.drive("pump").stop()
            await asyncio.sleep(1.2)
            return one.board(), one.telegrams("pump")

    with running_server(plant):
        board, telegrams = asyncio.run(watched())
    pump, fan = board.drives
    assert (pump.reachability, fan.reachability) == ("answers", "answers")
    assert pump.values["output_frequency"].reading
    assert telegrams


def test_watchdog_of_a_served_drive_cannot_be_set_by_the_program(plant):
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        pump = opened.drive("pump")
        with pytest.raises(UsageError, match=r"drivecomm.keep, which takes a lease"):
            set_watchdog(pump, "trip", 2)
        with pytest.raises(UsageError, match="fed by the server's own questions"):
            asyncio.run(set_watchdog_async(pump, "trip", 2))
        assert server.requests == []
        # Reading the watchdog and switching it off stay allowed, because neither promises a stop.
        set_watchdog(pump, "hold")
        assert read_watchdog(pump).policy == "hold"


def test_wrong_drive_error_keeps_its_attributes_through_a_server():
    error = WrongDriveError("modbus:1 is another", model="delta", found="it tells X", candidates=("invt",))
    there = error_of(error_content(error))
    assert (type(there), str(there), there.model, there.found, there.candidates) == (
        WrongDriveError,
        "modbus:1 is another",
        "delta",
        "it tells X",
        ("invt",),
    )


def test_machine_reference_goes_to_a_server_as_hertz(plant):
    plant.write_text(
        plant.read_text().replace("armed = true", 'armed = true\nmachine = { unit = "m/min", per_hz = 2 }')
    )
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        pump = opened.drive("pump")
        pump.set_reference(machine="20 m/min")
        assert [body["arguments"] for _, _, body in server.requests] == [{"hz": Decimal("10.00")}]
        for refused in ({"machine": "20 m/s"}, {"machine": 20, "hz": 10}):
            with pytest.raises(UsageError):
                pump.set_reference(**refused)
        with pytest.raises(NotSupported, match="of the plant file, or give the reference in hertz"):
            opened.drive("fan").set_reference(machine=20)
        assert len(server.requests) == 1
        other = opened.bus("hall").drive("vabus", 1, machine=drivecomm.MachineUnit(unit="m/min", per_hz=4))
        other.set_reference(machine=20)
        assert server.requests[-1][2]["arguments"] == {"hz": Decimal("5.00")}


def test_server_takes_a_machine_reference_and_reports_its_unit(plant):
    plant.write_text(
        plant.read_text().replace("armed = true", 'armed = true\nmachine = { unit = "m/min", per_hz = "1.25" }')
    )
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        pump = opened.drive("pump")
        order = {"id": "1", "arguments": {"machine": "12.5 m/min"}, "issued_s": time.time(), "valid_s": 5}
        with closing(LocalServer(server_of_plant(plant))) as server:
            assert server.order("/api/v1/drives/pump/set_reference", order)["outcome"] == "done"
            assert pump.read("480").value == Decimal("10.00")
            pump.set_reference(machine=25)
            assert pump.read("480").value == Decimal("20.00")
            assert server.ask("/api/v1/drives/pump")["machine_unit"] == "m/min"
