"""Line options: in the signatures, in type checks, and in the error for a misspelt name."""

from inspect import Parameter, signature
from pathlib import Path

import pytest

import drivecomm
from drivecomm.bus import Roster, port_opener
from drivecomm.plant import read_plant
from drivecomm.protocol import LINE_FACT_NAMES
from drivecomm.virtual import VirtualLine, virtual_drive

PLANT = """
format = 1

[[line]]
name = "hall"
port = "socket://127.0.0.1:9"

[[drive]]
name = "pump"
drive = "vabus:1"
"""


@pytest.fixture
def plant(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT, encoding="utf-8")
    return file


def options_of(opens):
    return {each.name for each in signature(opens).parameters.values() if each.kind is Parameter.KEYWORD_ONLY}


def test_line_options_annotations_match_all_accepted_options():
    taken = {*signature(Roster).parameters, *signature(port_opener).parameters} - {"facts", "port"}
    assert set(drivecomm.LineOptions.__annotations__) == LINE_FACT_NAMES | taken | {"record"}


@pytest.mark.parametrize("opens", [drivecomm.open_bus, drivecomm.open_bus_async])
def test_signature_of_an_opening_function_lists_each_option(opens):
    assert options_of(opens) == set(drivecomm.LineOptions.__annotations__)
    shown = signature(opens).parameters
    assert (shown["guard_s"].default, shown["echo"].default, shown["baudrate"].default) == (0.005, "off", None)


def test_signature_of_open_plant_lists_line_options_and_its_own():
    names = set(drivecomm.LineOptions.__annotations__)
    assert options_of(drivecomm.open_plant) == names | {"own_ports", "server"}
    assert options_of(drivecomm.OpenPlant) > names


def test_docstring_of_line_options_describes_each_option():
    for name in drivecomm.LineOptions.__annotations__:
        assert name in drivecomm.LineOptions.__doc__


@pytest.mark.parametrize("opens", [drivecomm.open_bus, drivecomm.open_bus_async])
def test_misspelt_line_option_error_suggests_the_right_name(opens):
    with pytest.raises(drivecomm.UsageError, match="did you mean 'trace'") as caught:
        opens(VirtualLine([virtual_drive("vabus", 1)]).port, tracee=print)
    for name in drivecomm.LineOptions.__annotations__:
        assert name in str(caught.value)


def test_misspelt_plant_option_is_refused_before_any_line_is_opened(plant):
    with pytest.raises(drivecomm.UsageError, match="did you mean 'server'"):
        drivecomm.open_plant(plant, serverr=True)
    with pytest.raises(drivecomm.UsageError, match="did you mean 'trace'"):
        drivecomm.OpenPlant(read_plant(plant), tracee=print)


def test_misspelt_drive_option_error_suggests_the_right_name():
    with (
        drivecomm.open_bus(VirtualLine([virtual_drive("vabus", 1)]).port) as bus,
        pytest.raises(drivecomm.UsageError, match="did you mean 'model'"),
    ):
        bus.drive("vabus", 1, mdoel="agile")


PROGRAM = """
import drivecomm
from drivecomm import AsyncDrive, Drive, PollItem


def plan(drive: Drive) -> list[drivecomm.PollItem]:
    return [PollItem(drive=drive, parameter="481")]


def plan_of_its_kind(drive: AsyncDrive) -> list[PollItem[AsyncDrive]]:
    return [PollItem(drive=drive, parameter="481")]


def run(drive: Drive, options: drivecomm.LineOptions) -> None:
    with drivecomm.open_bus("loop://", **options) as bus, drivecomm.open_plant(trace=print, server=True) as plant:
        for result in bus.poll(plan(drive)):
            print(result.reading, plant["pump"])


async def run_awaited(drive: AsyncDrive) -> None:
    async with drivecomm.open_bus_async("loop://", attempts=2):
        async for result in drivecomm.poll_async(plan_of_its_kind(drive)):
            print(result.reading)
"""


def checked(folder, program):
    api = pytest.importorskip("mypy.api")
    file = folder / "program.py"
    file.write_text(program, encoding="utf-8")
    root = Path(drivecomm.__file__).parents[1]
    told, _, _ = api.run(["--strict", "--config-file", "", "--cache-dir", str(root / ".cache" / "mypy"), str(file)])
    return [line.rpartition("[")[2].rstrip("]") for line in told.splitlines() if ": error:" in line]


def test_program_passes_strict_type_checks(tmp_path):
    assert checked(tmp_path, PROGRAM) == []


def test_type_checks_find_a_misspelt_option(tmp_path):
    assert checked(tmp_path, PROGRAM.replace("attempts=2", "atempts=2")) == ["call-arg"]
