"""The report command: the commissioning record of a drive."""

from pathlib import Path

import pytest

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "line"
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300" }
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
"""


@pytest.fixture
def line(shell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    Path("plant.toml").write_text(PLANT, encoding="utf-8")
    return shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 1))


def report(shell, *words):
    return shell("report", *words, "--by", "Anna", port=None)


def rows(shell):
    """Return the printed rows without their alignment."""
    return [" ".join(text.split()) for text in shell.out.splitlines()]


def test_record_names_identity_motor_link_loss_and_changed_settings(shell, line):
    line.drives[0].poke("3-41", 1234)
    line.drives[0].poke("8-03", 30)
    line.drives[0].poke("8-04", 2)
    assert report(shell, "fan") == 0
    text = rows(shell)
    assert "serial number, converter 012345G678" in text
    assert "motor_rated_power 4.00 kW 1-20" in text
    assert "if the master falls silent ramp after 3.0 s" in text
    assert "3-41 ramp_1_up_time 12.34 s factory 3.00 s" in text
    assert "approved set none" in text
    assert text[-1].startswith("recorded by Anna 2")


def test_record_compares_the_drive_with_its_baseline(shell, line):
    assert shell("baseline", "accept", "fan", "--by", "Bert", port=None) == 0
    assert report(shell, "fan") == 0
    assert any(text.startswith("approved set as approved by Bert on 2") for text in rows(shell))
    line.drives[0].poke("3-41", 1234)
    assert report(shell, "fan") == 0
    assert any(text.startswith("approved set 1 parameter differs, approved by Bert on 2") for text in rows(shell))


def test_record_lists_all_settings_of_a_drive_that_does_not_report_factory_values(shell, line):
    assert line
    assert report(shell, "pump") == 0
    heading = next(text for text in rows(shell) if text.startswith("Settings"))
    assert heading == "Settings: all 71, since the drive does not report its factory values"
    assert "482[3] fixed_frequency_3 25.00 Hz" in rows(shell)


def test_record_is_printed_as_json(shell, line):
    line.drives[0].poke("3-41", 1234)
    assert report(shell, "fan", "--json") == 0
    (told,) = shell.objects
    ramp = next(each for each in told["differing"] if each["parameter"] == "3-41")
    assert (ramp["factory"]["value"], ramp["now"]["value"], ramp["now"]["unit"]) == ("3.00", "12.34", "s")
    assert (told["by"], told["motor"]["1-20"]["value"], told["link_loss"]["time_s"]) == ("Anna", "4.00", None)


def test_html_page_escapes_texts_and_is_overwritten_only_with_force(shell, line):
    line.drives[0].poke("0-37", "<b>&")
    assert report(shell, "fan", "--html", "fan.html") == 0
    page = Path("fan.html").read_text(encoding="utf-8")
    assert "fan: commissioning record" in page
    assert "&lt;b&gt;&amp;" in page
    assert "<b>&" not in page
    assert report(shell, "fan", "--html", "fan.html") == 2
    assert report(shell, "fan", "--html", "fan.html", "--force") == 0


def test_report_on_a_silent_drive_writes_nothing(shell, line):
    line.power_off(line.drives[0])
    assert report(shell, "fan", "--html", "fan.html") == 4
    assert not Path("fan.html").exists()
    assert not shell.out
