"""Ten files as people have them: each imported, what was not understood listed, and a drive monitored from it."""

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
    """The case, what was found in its file, and the model file that was made of it."""
    found = read_foreign(FILES / name)
    path = tmp_path / "imported.toml"
    path.write_text(
        model_text(imported_model(found, name="imported", file=name, drive=CASES[name].drive)), encoding="utf-8"
    )
    return CASES[name], found, path


def drive_with(registers, tmp_path):
    """Return a virtual drive that has these words, by a model of its own."""
    entries = "".join(
        f'[[parameter]]\naddress = "{address}"\nname = "r_{address}"\nstart = "{word}"\n'
        for address, word in registers.items()
    )
    path = tmp_path / "drive.toml"
    path.write_text(
        f'format = 1\nprotocol = "modbus"\nname = "drive"\nsource = "this test"\n{entries}', encoding="utf-8"
    )
    return virtual_drive("modbus", 1, model=str(path))


def test_imported_model_is_in_order_and_every_fact_is_imported(imported, name):
    case, found, path = imported
    assert check_model(path) == []
    model = read_model(path, "modbus")
    assert {info.sure for info in model.parameters.values()} == {"imported"}
    assert all(info.source.startswith(f"{name}, ") for info in model.parameters.values())
    assert {info.name for info in model.parameters.values()} == {*case.reads, *case.written}
    assert {key: model.options[key] for key in model.options} == case.options
    assert all(any(word in each for each in found.assumptions) for word in case.assumed)


def test_import_lists_what_was_not_understood(imported):
    case, found, _ = imported
    assert [each.place for each in found.left] == [place for place, _ in case.left]
    for each, (_, reason) in zip(found.left, case.left, strict=True):
        assert reason in each.reason


def test_drive_is_monitored_from_the_imported_model(imported, tmp_path):
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
"""A virtual drive that was made by another model has the protocol's own line settings."""
