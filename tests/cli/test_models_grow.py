"""The models grow command, which makes a model from the answers of a drive."""

import pytest

from drivecomm.models import read_model
from drivecomm.virtual import virtual_drive


@pytest.fixture
def line(shell):
    return shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 1))


@pytest.fixture
def grown(shell, line):
    """Return a function that runs models grow on a line with two drives."""
    assert line.time == 0
    return lambda *arguments: shell("models", "grow", *arguments)


def test_grow_writes_a_range_and_a_single_parameter(grown, line, shell, tmp_path):
    path = tmp_path / "fan.toml"
    assert grown("danfoss-fc:3", "16-10..16-14", "3-41", "--write", str(path), "--model", "fc302") == 0
    assert "5 parameters written to" in shell.out
    assert "left out: the drive refused parameter 16-11" in shell.out
    model = read_model(path, "danfoss-fc")
    assert list(model.parameters) == ["16-10", "16-12", "16-13", "16-14", "3-41"]
    assert model.quantities["output_current"] == "16-14"
    assert model.name == "fan"
    assert shell("read", "danfoss-fc:3", "output_frequency", "--model", str(path)) == 0
    assert "0.0 Hz" in shell.out
    assert not line.drives[0].motor.running


@pytest.mark.soak
def test_grow_without_parameters_reads_all_of_the_protocols_model(grown, shell, tmp_path):
    path = tmp_path / "all.toml"
    assert grown("danfoss-fc:3", "-w", str(path), "--json", "-o", "option_texts=0") == 0
    named = {"drive": "danfoss-fc:3", "drive_name": "danfoss-fc:3"}
    assert shell.objects == [{**named, "file": str(path), "parameters": 94, "left_out": []}]
    assert len(read_model(path, "danfoss-fc").parameters) == 94


def test_grow_counts_refused_parameters_beyond_the_first_ten(grown, shell, tmp_path):
    path = tmp_path / "few.toml"
    assert grown("danfoss-fc:3", "8-00..8-49", "--write", str(path)) == 0
    assert shell.out.count("left out") == 11
    assert "left out: 29 more" in shell.out


def test_grow_writes_no_file_if_the_drive_describes_no_parameter(grown, shell, tmp_path):
    path = tmp_path / "none.toml"
    assert grown("danfoss-fc:3", "9-00..9-05", "--write", str(path)) == 5
    assert "answers none of 6 parameters" in shell.err
    assert not path.exists()


def test_grow_leaves_the_type_open_if_the_protocol_has_no_descriptions(grown, shell, tmp_path):
    path = tmp_path / "pump.toml"
    shell.line(virtual_drive("vabus", 1))
    assert grown("vabus:1", "480", "--write", str(path)) == 0
    (info,) = read_model(path, "vabus").parameters.values()
    assert (info.address, info.type, info.access, info.sure) == ("480", "", "r", "unconfirmed")


def test_unwritable_file_is_refused_before_anything_is_sent(grown, line, shell, tmp_path):
    (tmp_path / "there.toml").write_text("mine", encoding="utf-8")
    bad = {"there.toml": "exists already", "model.txt": "ends in .toml", "no/where.toml": "there is no folder"}
    for file, words in bad.items():
        assert grown("danfoss-fc:3", "16-14", "--write", str(tmp_path / file)) == 2
        assert words in shell.err
    assert line.time == 0
    assert (tmp_path / "there.toml").read_text(encoding="utf-8") == "mine"


def test_grow_writes_no_file_for_a_silent_drive(grown, tmp_path):
    path = tmp_path / "silent.toml"
    assert grown("danfoss-fc:4", "16-14", "--write", str(path)) == 4
    assert not path.exists()


@pytest.mark.parametrize(
    ("drive", "parameters"),
    [("danfoss-fc:3", ["16-14"]), ("vabus:1", ["481"]), ("modbus:5,model=abb-acs355", ["40004"]), ("uss:4", ["700"])],
)
def test_grown_model_of_one_parameter_passes_models_check(shell, tmp_path, drive, parameters):
    name, _, model = drive.partition(",model=")
    protocol, _, address = name.partition(":")
    shell.line(virtual_drive(protocol, int(address), **({"model": model} if model else {})))
    path = tmp_path / "grown.toml"
    words = ["models", "grow", name, *parameters, "--write", str(path)]
    assert shell(*words, *(["--model", model] if model else [])) == 0
    assert shell("models", "check", str(path), port=None) == 0, shell.out
