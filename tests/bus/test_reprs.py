"""The repr of objects that users meet at the prompt: their kind and their place."""

import asyncio
from decimal import Decimal

import pytest

import drivecomm
from drivecomm.plant import read_plant
from drivecomm.protocol import DriveState, DriveStatus, installed
from drivecomm.virtual import DriveProxy, VirtualLine, VirtualPlant, virtual_drive

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
def line():
    return VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3)])


def test_repr_of_a_bus_shows_its_drives_and_state(line):
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("vabus", 1)
        assert repr(bus) == "<Bus on a port object, 1 drive, open>"
        line.broken = True
        with pytest.raises(drivecomm.LinkDownError):
            bus.drive("vabus", 1).status()
        assert repr(bus) == "<Bus on a port object, 1 drive, port lost>"
    assert repr(bus) == "<Bus on a port object, 1 drive, closed>"


def test_repr_of_a_bus_shows_its_port():
    with drivecomm.open_bus("loop://") as bus:
        assert repr(bus) == "<Bus loop://, 0 drives, open>"


def test_repr_of_an_async_bus_shows_whether_it_is_open(line):
    async def shown():
        bus = drivecomm.open_bus_async(line.port)
        before = repr(bus)
        async with bus:
            return before, repr(bus)

    assert asyncio.run(shown()) == (
        "<AsyncBus on a port object, 0 drives, not open yet>",
        "<AsyncBus on a port object, 0 drives, open>",
    )


def test_repr_of_a_plant_shows_its_file_and_lines(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT, encoding="utf-8")
    assert repr(drivecomm.open_plant(file)) == f"<OpenPlant {file}, 1 drive on 1 line, 0 of them open>"
    assert repr(VirtualPlant(read_plant(file))) == f"<VirtualPlant {file}, 1 drive on 1 line>"


def test_repr_of_a_virtual_line_shows_its_drives_and_time(line):
    line.advance(2.5)
    assert repr(line) == "<VirtualLine with 2 drives, at 2.5 s>"
    assert repr(line.port()) == f"<VirtualPort of {line!r}>"


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_repr_of_a_virtual_drive_shows_its_address_and_motor(plugin):
    address = plugin.addresses[0]
    drive = virtual_drive(plugin.name, address)
    assert repr(drive) == f"<{type(drive).__name__} at address {address}, stopped>"
    drive.motor.run(50.0, 0.0)
    drive.motor.advance(100.0)
    assert repr(drive) == f"<{type(drive).__name__} at address {address}, 50 Hz>"
    drive.motor.trip(7, 100.0)
    assert repr(drive) == f"<{type(drive).__name__} at address {address}, fault 7>"


def test_repr_of_a_drive_proxy_shows_its_drive():
    drive = virtual_drive("vabus", 1)
    assert repr(DriveProxy(drive)) == f"<DriveProxy of {drive!r}>"


def test_repr_of_protocols_and_models_shows_their_names(line):
    assert repr(installed) == f"<Protocols {', '.join(installed)}>"
    assert repr(installed["vabus"]) == "<Protocol vabus: Bonfiglioli VABus>"
    with drivecomm.open_bus(line.port) as bus:
        model = bus.drive("vabus", 1, model="agile").model
    assert repr(model) == f"<Model agile of vabus, {len(model.parameters)} parameters>"


def test_repr_of_health_shows_whether_the_drive_answers():
    with drivecomm.open_bus(VirtualLine([virtual_drive("vabus", 1)]).port) as bus:
        bus.drive("vabus", 1).status()
        silent = bus.drive("vabus", 2)
        assert repr(bus.health["vabus:1"]) == "<Health: answers>"
        with pytest.raises(drivecomm.NoReplyError):
            silent.status()
        assert repr(bus.health["vabus:2"]) in {
            "<Health: no answer to the last 1 call>",
            "<Health: does not answer, probed now and then>",
        }


@pytest.mark.parametrize(
    ("status", "shown"),
    [
        (DriveStatus(word=1, state=DriveState.READY, running=False, fault=False), "ready"),
        (
            DriveStatus(
                word=1,
                state=DriveState.RUNNING,
                running=True,
                fault=False,
                at_reference=True,
                reverse=True,
                warning=True,
                actual_hz=Decimal("25.0"),
            ),
            "running, 25.0 Hz, at reference, reverse, warning",
        ),
        (
            DriveStatus(
                word=1, state=DriveState.FAULT, running=False, fault=True, fault_code=14, fault_text="overcurrent"
            ),
            "fault, 14 overcurrent",
        ),
        (
            DriveStatus(
                word=1,
                state=DriveState.NOT_READY,
                running=False,
                fault=False,
                remote=False,
                actual_percent=Decimal(0),
            ),
            "not_ready, 0 %, not under bus control",
        ),
    ],
)
def test_str_of_a_status_is_short(status, shown):
    assert str(status) == shown
