"""Virtual drives whose requests continue an earlier one, or that share an address: which drives obey, and how long."""

import pytest

import drivecomm
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig, installed
from drivecomm.virtual import VirtualPlant

REPEAT = b"\x15"
FIRST, SECOND = b"\x020121+0.0\x03$", b"\x020121+25.0\x033"


class Hall:
    """A line of a plant with drives at these addresses, and a master that sends and receives bytes."""

    def __init__(self, protocol, *addresses):
        drives = [DriveConfig(protocol=protocol, address=each, name=f"d{each}", line="hall") for each in addresses]
        plant = VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=tuple(drives)))
        self.protocol, self.line = protocol, plant.line("hall")
        self.port = self.line.port()
        self.port.configure(installed[protocol].facts.settings)

    def say(self, data):
        """Send bytes; return the bytes received within half a second."""
        self.port.write(data)
        self.line.advance(0.5)
        return self.line.take()

    def ask(self, **fields):
        return self.say(drivecomm.encode(self.protocol, fields, direction="request"))

    def held(self, parameter):
        return [drive.peek(parameter, self.line.time) for drive in self.line.drives]


def read(hall, address):
    group, unit = divmod(address, 10)
    return hall.ask(kind="read", group=group, unit=unit, menu=1, parameter=21)


@pytest.fixture
def hall():
    found = Hall("ct-ansi", 11, 12)
    found.line.drives[1].poke("01.21", 250)
    return found


def test_reply_of_another_drive_is_not_executed_as_a_write(hall):
    assert read(hall, 11) == FIRST
    assert read(hall, 12) == SECOND
    assert hall.held("01.21") == [0, 250]


def test_short_request_is_answered_only_by_the_drive_addressed_last(hall):
    assert (read(hall, 11), hall.say(REPEAT)) == (FIRST, FIRST)
    assert (read(hall, 12), hall.say(REPEAT)) == (SECOND, SECOND)


@pytest.mark.parametrize("said", [b"\x00", b"1", b"\x01\x03\x00\x06\x00\x01", b"\x04\x04"])
def test_short_request_after_other_characters_is_not_answered(hall, said):
    assert read(hall, 11) == FIRST
    assert hall.say(said) == b""
    assert hall.say(REPEAT) == b""


def test_rest_of_a_write_with_a_damaged_address_is_ignored(hall):
    """After its broken head, it looks like a repeated write for the drive addressed last."""
    write = drivecomm.encode(
        "ct-ansi",
        {"kind": "write", "group": 1, "unit": 2, "menu": 1, "parameter": 21, "data": "+40.0"},
        direction="request",
    )
    assert read(hall, 11) == FIRST
    assert hall.say(b"\x041132" + write[5:]) == b""
    assert hall.held("01.21") == [0, 250]


@pytest.mark.parametrize(("address", "raw"), [(10, [400, 400, 0]), (0, [400, 400, 400]), (20, [0, 0, 400])])
def test_plant_drives_obey_the_address_of_their_group(address, raw):
    hall = Hall("ct-ansi", 11, 19, 21)
    group, unit = divmod(address, 10)
    assert hall.ask(kind="write", group=group, unit=unit, menu=1, parameter=21, data="+40.0") == b""
    assert hall.held("01.21") == raw


def test_lecom_plant_drives_obey_the_address_of_their_group():
    hall = Hall("lecom", 31, 39, 41)
    hall.ask(kind="send", address=30, code=11, data="42.5")
    assert hall.held("C0011") == [425, 425, 500]
