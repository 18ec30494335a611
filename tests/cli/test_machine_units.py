"""The unit of the machine at the command line: references in it, and values beside those in hertz."""

import pytest

from drivecomm.plant import read_plant
from drivecomm.virtual import VirtualPlant

PLANT = """
format = 1

[[line]]
name = "hall"
port = "HALL"

[[drive]]
name = "belt"
drive = "vabus:1"
options = { model = "agile" }
armed = true
machine = { unit = "m/min", per_hz = "1.25" }

[[drive]]
name = "shaft"
drive = "vabus:2"
options = { model = "agile" }
armed = true
machine = { unit = "rpm", poles = 4, gear = "5.2" }

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300" }
armed = true
"""


@pytest.fixture
def hall(shell, tmp_path, monkeypatch):
    """The virtual line of a plant whose drives have machines."""
    path = tmp_path / "plant.toml"
    path.write_text(PLANT)
    monkeypatch.setenv("DRIVECOMM_PLANT", str(path))
    line = VirtualPlant(read_plant(path)).line("hall")
    shell.lines["HALL"] = line
    return line


@pytest.mark.parametrize("words", [("12.5m/min",), ("12.5 m/min",), ("--machine", "12.5"), ("--machine", "12.5 m/min")])
def test_reference_is_given_in_the_unit_of_the_machine(shell, hall, words):
    assert shell("reference", "belt", *words, port=None) == 0
    assert "belt  reference 12.5 m/min (10.00 Hz)" in shell.out
    assert hall.drives[0].peek("480", 0) == f"{1000:08X}"
    assert shell("reference", "belt", *words, "--json", port=None) == 0
    assert shell.objects[0]["done"] == "reference 12.5 m/min (10.00 Hz)"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("belt", "12.5m/s"), "'12.5m/s' is no reference in %, Hz, rpm or m/min; write 12.5%, 12.5Hz, 12.5rpm or"),
        (("belt", "12.5"), "12.5rpm or 12.5m/min"),
        (("belt", "--machine", "12.5 m/s"), "is no reference in m/min, the unit of this machine; write 10 m/min"),
        (("belt", "--machine", "fast"), "is no reference in m/min"),
        (("belt", "63 m/min"), "a reference of 50.40 Hz is above 50.00 Hz"),
        (("belt", "--machine", "12.5", "--hz", "10"), "one of percent, hz, rpm and machine"),
        (("belt", "10Hz", "--machine", "12.5"), "10Hz and --machine 12.5 exclude each other"),
        (("shaft", "100rpm"), "write --rpm 100 or --machine 100"),
        (("fan", "12.5m/min"), 'or machine = { unit = "m/min", per_hz = "1.25" } in the plant file'),
        (("fan", "--machine", "12.5"), 'write machine = { unit = "m/min", per_hz = "1.25" } in its [[drive]]'),
    ],
)
def test_reference_that_cannot_be_changes_nothing(shell, hall, words, sentence):
    before = hall.drives[0].peek("480", 0)
    assert shell("reference", *words, port=None) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
    assert hall.drives[0].peek("480", 0) == before


def test_reference_in_rpm_of_a_shaft_names_its_flag(shell, hall):
    assert shell("reference", "shaft", "--machine", "100", port=None) == 0
    assert "reference 100 rpm (17.33 Hz)" in shell.out
    assert hall.drives[1].peek("480", 0) == f"{1733:08X}"
    assert shell("reference", "shaft", "--rpm", "1200", port=None) == 0
    assert hall.drives[1].peek("480", 0) == f"{4000:08X}"
