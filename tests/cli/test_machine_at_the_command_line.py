"""Machine units at the command line: references in them, and values shown beside those in hertz."""

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

[[drive]]
name = "mixer"
drive = "danfoss-fc:4"
options = { model = "fc300", reference_maximum_hz = 50 }
armed = true
machine = { unit = "m/min", per_hz = "1.25" }
"""


@pytest.fixture
def hall(shell, tmp_path, monkeypatch):
    """Return the virtual line of a plant whose drives have machine units."""
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
        (("belt", "12.5m/s"), "'12.5m/s' is not a reference in %, Hz, rpm or m/min; write 12.5%, 12.5Hz, 12.5rpm or"),
        (("belt", "12.5"), "12.5rpm or 12.5m/min"),
        (("belt", "--machine", "12.5 m/s"), "is not a reference in m/min, the unit of this machine; write 10 m/min"),
        (("belt", "--machine", "fast"), "is not a reference in m/min"),
        (("belt", "63 m/min"), "a reference of 50.40 Hz is above 50.00 Hz"),
        (("belt", "--machine", "12.5", "--hz", "10"), "one of percent, hz, rpm and machine"),
        (("belt", "10Hz", "--machine", "12.5"), "10Hz and --machine 12.5 exclude each other"),
        (("shaft", "100rpm"), "write --rpm 100 or --machine 100"),
        (("fan", "12.5m/min"), 'or machine = { unit = "m/min", per_hz = "1.25" } in the plant file'),
        (("fan", "--machine", "12.5"), 'write machine = { unit = "m/min", per_hz = "1.25" } in its [[drive]]'),
    ],
)
def test_invalid_reference_changes_nothing(shell, hall, words, sentence):
    before = hall.drives[0].peek("480", 0)
    assert shell("reference", *words, port=None) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
    assert hall.drives[0].peek("480", 0) == before


def test_machine_flag_and_rpm_flag_differ_for_a_geared_shaft(shell, hall):
    assert shell("reference", "shaft", "--machine", "100", port=None) == 0
    assert "reference 100 rpm (17.33 Hz)" in shell.out
    assert hall.drives[1].peek("480", 0) == f"{1733:08X}"
    assert shell("reference", "shaft", "--rpm", "1200", port=None) == 0
    assert hall.drives[1].peek("480", 0) == f"{4000:08X}"


@pytest.mark.usefixtures("hall")
def test_frequencies_are_read_with_the_speed_of_the_machine(shell):
    assert shell("reference", "belt", "12.5m/min", port=None) == 0
    assert shell("read", "belt", "reference_frequency", "output_frequency", "output_current", port=None) == 0
    reference, output, current = shell.out.splitlines()
    assert "10.00 Hz = 12.50 m/min" in reference
    assert "0.00 Hz = 0.00 m/min" in output
    assert " = " not in current
    assert shell("read", "belt", "reference_frequency", "output_current", "--json", port=None) == 0
    reference, current = shell.objects
    assert (reference["value"], reference["unit"]) == ("10.00", "Hz")
    assert (reference["machine_value"], reference["machine_unit"]) == ("12.50", "m/min")
    assert "machine_value" not in current
    assert shell("read", "fan", "output_frequency", port=None) == 0
    assert " = " not in shell.out


@pytest.mark.usefixtures("hall")
def test_status_of_a_drive_shows_the_speed_of_the_machine(shell):
    assert shell("reference", "mixer", "--machine", "12.5", port=None) == 0
    assert shell("start", "mixer", "--percent", "20", "--link-loss", "hold", port=None) == 0
    assert shell("wait", "mixer", "at_reference", "--seconds", "60", port=None) == 0
    assert "Hz = 12.50 m/min" in shell.out
    assert shell("status", "mixer", "--json", port=None) == 0
    assert (shell.objects[0]["actual_machine"], shell.objects[0]["machine_unit"]) == ("12.50", "m/min")
    assert shell("status", "belt", "--json", port=None) == 0
    assert "actual_machine" not in shell.objects[0]


@pytest.mark.usefixtures("hall")
def test_status_of_the_plant_shows_the_speed_of_the_machines(shell):
    assert shell("reference", "belt", "12.5m/min", port=None) == 0
    assert shell("status", port=None) == 0
    row = next(line for line in shell.out.splitlines() if line.startswith("belt "))
    assert "0.00 Hz = 0.00 m/min" in row
    assert "10.00 Hz = 12.50 m/min" in row
    assert shell("status", "--json", port=None) == 0
    belt, shaft, fan, _ = shell.objects
    assert [belt[key] for key in ("output_machine", "reference_machine", "machine_unit")] == ["0.00", "12.50", "m/min"]
    assert shaft["machine_unit"] == "rpm"
    assert "machine_unit" not in fan


@pytest.mark.usefixtures("hall")
def test_poll_shows_the_speed_of_the_machine(shell):
    poll = ("poll", "belt", "output_frequency", "output_current", "--cycles", "1")
    assert shell(*poll, port=None) == 0
    frequency, current = shell.out.splitlines()
    assert "0.00 Hz = 0.00 m/min  good" in frequency
    assert " = " not in current
    assert shell(*poll, "--json", port=None) == 0
    assert [each.get("machine_unit") for each in shell.objects] == ["m/min", None]
