"""Ten register files of other programs: each is imported, omissions are listed, and a drive is monitored by it."""

from decimal import Decimal

import pytest
from imported_files import CASES, FILES

import drivecomm
from drivecomm.commissioning.importing import imported_model, read_foreign
from drivecomm.errors import NotSupported
from drivecomm.models import check_model, model_text, read_model
from drivecomm.virtual import VirtualLine, virtual_drive

pytestmark = pytest.mark.parametrize("name", CASES)


@pytest.fixture
def imported(name, tmp_path):
    """Import a file; return its case, the facts found in it, and the path of the model file."""
    found = read_foreign(FILES / name)
    path = tmp_path / "imported.toml"
    path.write_text(
        model_text(imported_model(found, name="imported", file=name, drive=CASES[name].drive)), encoding="utf-8"
    )
    return CASES[name], found, path


def drive_with(registers, tmp_path):
    """Return a virtual drive that holds these words, with a model made for them."""
    entries = "".join(
        f'[[parameter]]\naddress = "{address}"\nname = "r_{address}"\nstart = "{word}"\n'
        for address, word in registers.items()
    )
    path = tmp_path / "drive.toml"
    path.write_text(
        f'format = 1\nprotocol = "modbus"\nname = "drive"\nsource = "this test"\n{entries}', encoding="utf-8"
    )
    return virtual_drive("modbus", 1, model=str(path))


def test_imported_model_is_valid_and_marks_every_fact_as_imported(imported, name):
    case, found, path = imported
    assert check_model(path) == []
    model = read_model(path, "modbus")
    assert {info.sure for info in model.parameters.values()} == {"imported"}
    assert all(info.source.startswith(f"{name}, ") for info in model.parameters.values())
    assert {info.name for info in model.parameters.values()} == {*case.reads, *case.written}
    assert {key: model.options[key] for key in model.options} == case.options
    assert all(any(word in each for each in found.assumptions) for word in case.assumed)


def test_import_lists_every_fact_left_out(imported):
    case, found, _ = imported
    assert [each.place for each in found.left] == [place for place, _ in case.left]
    for each, (_, reason) in zip(found.left, case.left, strict=True):
        assert reason in each.reason


def test_drive_is_monitored_by_the_imported_model_and_never_commanded(imported, tmp_path):
    case, _, path = imported
    line, sent = VirtualLine([drive_with(case.registers, tmp_path)]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model=str(path), **LINE_OF_THE_TEST)
        for name, (value, unit) in case.reads.items():
            reading = drive.read(name)
            assert (Decimal(reading.value), reading.unit) == (Decimal(value), unit), name
            assert reading.note == "type and unit are imported from a file of another program"
        sent.clear()
        assert drive.capabilities.monitoring_only
        for command in (drive.start, drive.stop, drive.reset, lambda: drive.set_reference(hz=10)):
            with pytest.raises(NotSupported):
                command()
        for place, value in (*dict.fromkeys((*case.reads, *case.written), 0).items(), ("0x2002", 1), ("0x1003", 1)):
            with pytest.raises(NotSupported):
                drive.write(place, value)
        assert not sent


LINE_OF_THE_TEST = {"baudrate": 9600, "bytesize": 8, "parity": "N", "stopbits": 1}
"""Line settings of the virtual drive: the protocol's own, because its model states none."""
