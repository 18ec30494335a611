"""Model facts that a user has confirmed on a drive: their readings carry no note."""

from dataclasses import replace
from types import MappingProxyType

import pytest

import drivecomm
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import load_model, with_confirmed
from drivecomm.plant import plant_text, read_plant
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.mark.parametrize("name", ["output_frequency", "210", "stator_frequency"])
def test_reading_of_a_confirmed_fact_has_no_note_by_name_or_address(name):
    line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
    with drivecomm.open_bus(line.port) as bus:
        plain = DriveConfig(protocol="vabus", address=1, options={"model": "agile"})
        checked = replace(plain, confirmed=(name,))
        assert plain.build(bus.drive).read("output_frequency").note == "type and unit are derived"
        drive = checked.build(bus.drive)
        assert (drive.read("output_frequency").note, drive.read("210").note) == ("", "")
        assert drive.read("output_current").note == "type and unit are derived"


def test_confirming_an_unknown_fact_suggests_similar_names():
    model = agile()
    with pytest.raises(UsageError, match="agile has no parameter 'output_frequncy' that could be confirmed; did you"):
        with_confirmed(model, ["output_frequncy"])
    with pytest.raises(UsageError, match="models show lists them"):
        with_confirmed(model, ["zzz"])
    with pytest.raises(UsageError, match="give a list of parameters"):
        with_confirmed(model, "output_frequency")


def test_contradicted_fact_cannot_be_confirmed():
    model = agile()
    against = replace(model.parameters["210"], sure="contradicted", proof="proofs/one.toml")
    model = replace(model, parameters=MappingProxyType({**model.parameters, "210": against}))
    with pytest.raises(UsageError, match=r"because proofs/one\.toml contradicts it"):
        with_confirmed(model, ["output_frequency"])


def test_drive_without_a_model_refuses_confirmed_facts():
    line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(UsageError, match="name the drive's model"):
        bus.drive("vabus", 1, confirmed_facts=["210"])


def test_confirmed_facts_are_read_from_and_written_to_the_plant_file(tmp_path):
    file = tmp_path / "plant.toml"
    text = 'format = 1\n[[line]]\nname = "hall"\n[[drive]]\ndrive = "vabus:1"\nconfirmed = ["210"]\n'
    file.write_text(text)
    plant = read_plant(file)
    assert plant.drives[0].confirmed == ("210",)
    file.write_text(plant_text(plant))
    assert read_plant(file).drives == plant.drives
    file.write_text(text.replace('"210"', "210"))
    with pytest.raises(FileFormatError, match="confirmed holds texts in quotes"):
        read_plant(file)


def agile():
    return load_model("drivecomm_vabus", "vabus", "agile")
