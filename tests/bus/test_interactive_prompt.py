"""Completion and help() at an interactive prompt, and errors of calls with wrong arguments."""

import asyncio
import subprocess
import sys
from rlcompleter import Completer

import pytest

import drivecomm
from drivecomm.protocol import DriveState, Stop, needs_answer, new_reading
from drivecomm.virtual import VirtualLine, virtual_drive

OF_A_DRIVE = {
    "call", "capabilities", "facts", "hold", "identify", "in_ram_only", "jog", "machine", "may_start", "model", "name",
    "parameters", "probe", "read", "read_many", "read_only_reason", "reset", "reverse", "select_preset",
    "select_setup", "set_reference", "set_relay", "start", "status", "stop", "wait_for", "write", "write_and_read",
}  # fmt: skip
OF_A_BUS = {
    "broadcast", "close", "counters", "drive", "health", "listen", "now", "other_master", "poll", "real_time", "scan",
    "sleep_until", "statistics", "stop_all",
}  # fmt: skip


@pytest.fixture
def line():
    return VirtualLine([virtual_drive("vabus", 1, model="agile"), virtual_drive("danfoss-fc", 3)])


@pytest.fixture
def bus(line):
    with drivecomm.open_bus(line.port) as opened:
        yield opened


@pytest.fixture
def drive(bus):
    return bus.drive("vabus", 1, model="agile")


def shown(thing):
    return {name for name in dir(thing) if not name.startswith("_")}


def completed(text, **names):
    completer = Completer(names)
    found = []
    while (match := completer.complete(text, len(found))) is not None:
        found.append(match)
    return [each.rstrip("()") for each in found]


def test_dir_of_a_drive_and_a_bus_shows_the_public_names(bus, drive):
    assert shown(drive) == OF_A_DRIVE
    assert shown(bus) == OF_A_BUS
    assert shown(bus.broadcast("vabus")) == {"capabilities", "stop", "write"}


def test_dir_of_async_drives_and_buses_shows_the_same_names(line):
    async def both():
        async with drivecomm.open_bus_async(line.port) as bus:
            return shown(bus.drive("vabus", 1, model="agile")), shown(bus)

    assert asyncio.run(both()) == (OF_A_DRIVE, OF_A_BUS)


def test_names_missing_from_dir_can_still_be_used(drive):
    assert drive.polled_status().state is DriveState.NOT_READY
    assert drive.bus.wall_time() > 0


def test_prompt_completes_verbs_and_names_of_parameters(drive):
    assert completed("drive.set_r", drive=drive) == ["drive.set_reference", "drive.set_relay"]
    assert "drive.parameters.output_frequency" in completed("drive.parameters.output_f", drive=drive)
    assert "fixed_frequency_2" in drive.parameters._ipython_key_completions_()


def test_parameters_are_found_by_name_and_as_attributes(drive):
    assert str(drive.read(drive.parameters.fixed_frequency_2)) == "10.00 Hz"
    assert drive.parameters["fixed_frequency_2"].address == "481"
    assert drive.parameters["output_frequency"].unit == "Hz"
    assert len(drive.parameters) == len(set(drive.parameters)) > 50


def test_unknown_parameter_error_suggests_the_nearest_name(bus, drive):
    with pytest.raises(AttributeError, match="did you mean 'fixed_frequency_2'"):
        drive.parameters.fixed_frequenzy_2  # noqa: B018
    with pytest.raises(AttributeError, match="give a model"):
        bus.drive("vabus", 1).parameters.fixed_frequency_2  # noqa: B018


CALLS = {
    "set_reference(50)": (lambda drive: drive.set_reference(50), "write percent=50 or hz=50 or rpm=50 or machine=50"),
    "start(True)": (lambda drive: drive.start(True), "start does not take True without a name; write reverse=True"),
    "write('480', 1, True)": (lambda drive: drive.write("480", 1, True), "write store=True"),
    "read()": (lambda drive: drive.read(), r"missing a required argument: 'parameter'; it takes \(parameter, "),
    "read('480', '481')": (lambda drive: drive.read("480", "481"), "too many positional arguments"),
    "set_relay(1)": (lambda drive: drive.set_relay(1), r"missing a required argument: 'on'; it takes \(number, on\)"),
    "start(reversed=True)": (lambda drive: drive.start(reversed=True), "unexpected keyword argument 'reversed'"),
}


@pytest.mark.parametrize(("call", "match"), CALLS.values(), ids=CALLS)
def test_call_with_wrong_arguments_names_the_right_ones(drive, call, match):
    with pytest.raises(drivecomm.UsageError, match=match):
        call(drive)


@pytest.mark.parametrize(("call", "match"), CALLS.values(), ids=CALLS)
def test_async_call_with_wrong_arguments_names_the_right_ones(line, call, match):
    async def called():
        async with drivecomm.open_bus_async(line.port) as bus:
            await call(bus.drive("vabus", 1, model="agile"))

    with pytest.raises(drivecomm.UsageError, match=match):
        asyncio.run(called())


def test_wait_for_accepts_the_text_of_a_state(drive):
    assert drive.wait_for("not_ready").state is DriveState.NOT_READY
    with pytest.raises(drivecomm.UsageError, match="did you mean 'running'"):
        drive.wait_for("runing")


def test_async_wait_for_accepts_the_text_of_a_state(line):
    async def waited():
        async with drivecomm.open_bus_async(line.port) as bus:
            return await bus.drive("vabus", 1, model="agile").wait_for("not_ready")

    assert asyncio.run(waited()).state is DriveState.NOT_READY


def test_stop_all_accepts_the_text_of_a_way_to_stop(line, bus, drive):
    drive.set_reference(percent=50)
    drive.start()
    line.advance(10)
    results = bus.stop_all("coast")
    assert {(each.how, each.error) for each in results} == {(Stop.COAST, None)}
    assert not line.drives[0].motor.running


def test_async_stop_all_accepts_the_text_of_a_way_to_stop(line):
    async def stopped():
        async with drivecomm.open_bus_async(line.port) as bus:
            bus.drive("vabus", 1, model="agile")
            return await bus.stop_all("coast")

    assert {each.how for each in asyncio.run(stopped())} == {Stop.COAST}


def test_stop_all_refuses_an_unknown_way_to_stop(bus, drive):
    with pytest.raises(drivecomm.UsageError, match="did you mean 'coast'"):
        bus.stop_all("caost")
    assert drive.status().state is DriveState.NOT_READY


def test_unreadable_data_set_error_names_the_readable_one(drive):
    with pytest.raises(drivecomm.ParameterAddressError, match="read data set 4") as caught:
        drive.read("481", dataset=9)
    assert "did you mean" not in str(caught.value)


def test_value_beyond_its_type_is_refused_with_the_limit_in_its_unit():
    line = VirtualLine([virtual_drive("modbus", 1, model="optidrive-plus")])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(drivecomm.ValueRefusedError) as caught:
        bus.drive("modbus", 1, model="eaton-dc1").set_reference(hz=-500)
    assert str(caught.value) == "-500 for parameter 2 is below 0.0 Hz, the lowest value that u16 holds"


def test_modules_are_attributes_of_drivecomm():
    code = "import drivecomm; print(drivecomm.bus.__name__); drivecomm.buss"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.stdout == "drivecomm.bus\n"
    assert "AttributeError" in done.stderr


def test_help_describes_a_frozen_factory_and_a_decorator():
    assert new_reading.__doc__.startswith("Return a Reading")
    assert "parameter: its address" in new_reading.__doc__
    assert needs_answer.__name__ == "needs_answer"
    assert "@needs_answer" in needs_answer.__doc__
