"""Facts of Mitsubishi drives over Modbus, with the page of each."""

import pytest

import drivecomm
from drivecomm.models import link_loss_of, load_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

MODEL = load_model(installed["modbus"].package, "modbus", "mitsubishi")


def status_with(word):
    """Return the status of a drive whose register 40009 holds this word."""
    virtual = virtual_drive("modbus", 1, model="mitsubishi")
    virtual._machine.live = lambda _: None
    virtual.poke("40009", word)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        return bus.drive("modbus", 1, model="mitsubishi").status()


@pytest.mark.parametrize(
    ("word", "running", "reverse"),
    [
        (0x0003, True, False),
        (0x0005, True, True),
        # Bit 0 follows Pr. 190 (FR-F700-NA p. 231, FR-F720P p. 246) and may have another meaning there.
        (0x0002, True, False),
        (0x0004, True, True),
        (0x0001, False, None),
        (0x0000, False, None),
    ],
)
def test_running_is_read_from_the_unassignable_status_bits(word, running, reverse):
    status = status_with(word)
    assert status.running is running
    assert bool(status.reverse) is bool(reverse)


@pytest.mark.parametrize(("word", "fault"), [(0x8000, True), (0x0080, False), (0x0000, False)])
def test_fault_is_bit_15_and_not_an_assignable_output(word, fault):
    assert status_with(word).fault is fault


def test_virtual_drive_shows_both_directions():
    line = VirtualLine([virtual_drive("modbus", 1, model="mitsubishi")])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="mitsubishi")
        for reverse, word in ((False, 0x0003), (True, 0x0005)):
            drive.set_reference(hz=20)
            drive.start(reverse=reverse)
            line.advance(30)
            status = drive.status()
            assert (status.word & 7, status.reverse) == (word, reverse)
            drive.stop()
            line.advance(30)
            assert not drive.status().running


def test_link_loss_names_the_parameter_of_each_connector():
    # Pr. 122: FR-E720-008 p. 231, FR-E720-0.1K p. 222; Pr. 539: FR-A800 p. 579, FR-F720-NA p. 234
    said = link_loss_of(MODEL)
    assert said.index("Pr. 122") < said.index("Pr. 539")
    assert "E.PUE" in said


@pytest.mark.parametrize("name", ["output_voltage", "acceleration_time", "deceleration_time"])
def test_value_without_a_documented_scale_has_no_common_name(name):
    assert name not in MODEL.quantities
