"""The models setup command: the panel settings of a series, filled in for a drive, as text, JSON and HTML."""

import json
import re

import pytest

from drivecomm.cli import main

PLANT = """
format = 1
[[line]]
name = "hall"
port = "/dev/ttyUSB7"
baudrate = 19200
[[drive]]
name = "pump"
drive = "uss:3"
line = "hall"
options = { model = "v20" }
link_loss = { policy = "trip", watchdog_s = 2 }
[[drive]]
name = "mill"
drive = "modbus:31"
line = "hall"
options = { model = "yaskawa", baudrate = 9600 }
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"
"""


@pytest.fixture
def plant(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    path = tmp_path / "hall.toml"
    path.write_text(PLANT, encoding="utf-8")
    return str(path)


def rows(capsys, *words):
    assert main(["models", "setup", *words, "--json"]) == 0
    return {
        each["setting"]["parameter"]: (each["value"], each["made_of"])
        for each in map(json.loads, capsys.readouterr().out.splitlines())
    }


@pytest.mark.usefixtures("plant")
def test_series_alone_is_filled_in_with_its_defaults(capsys):
    sheet = rows(capsys, "uss/v20")
    assert sheet["P2010[0]"] == ("6", "9600 baud = 6")
    assert sheet["P2011[0]"] == ("", "its own address on the line")
    assert sheet["P0700"] == ("5", "USS/Modbus on RS485")


def test_setup_for_a_plant_drive_uses_the_values_of_the_plant(plant, capsys):
    sheet = rows(capsys, "--for", "pump", "--plant", plant)
    assert sheet["P2010[0]"] == ("7", "19200 baud = 7"), "its line says so"
    assert sheet["P2011[0]"] == ("3", "address 3")
    assert sheet["P2014[0]"] == ("2000", "2000 ms"), "its link loss says so"
    assert rows(capsys, "yaskawa", "--for", "mill", "--plant", plant)["H5-01"][0] == "1F"


@pytest.mark.usefixtures("plant")
def test_drive_may_be_named_without_a_plant(capsys):
    assert rows(capsys, "v20", "--for", "uss:5,baudrate=38400")["P2010[0]"] == ("8", "38400 baud = 8")
    assert rows(capsys, "--for", "uss:5,model=v20")["P2011[0]"] == ("5", "address 5")


def test_sheet_as_text_names_values_factory_marks_and_sources(plant, capsys):
    assert main(["models", "setup", "--for", "pump", "--plant", plant]) == 0
    text = capsys.readouterr().out
    assert text.startswith("uss/v20  Siemens SINAMICS V20, for pump (uss:3), at 19200 8E1\n")
    lines = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    assert ["So that it talks"] in lines
    (rate,) = [line for line in lines if line[0] == "P2010[0]"]
    assert rate[1:5] == ["baud rate", "7", "19200 baud = 7", "factory 8"]
    assert rate[5].startswith("no value is known for 1200, 2400, 4800 and 57600 baud; SINAMICS V20 operating")
    (address,) = [line for line in lines if line[0] == "P2011[0]"]
    assert "derived" in address


@pytest.mark.usefixtures("plant")
def test_baud_rate_without_a_known_code_is_reported(capsys):
    assert main(["models", "setup", "--for", "modbus:1,model=yaskawa,baudrate=19200"]) == 0
    assert "no value is known for 19200 baud, only for 9600" in capsys.readouterr().out


@pytest.mark.usefixtures("plant")
def test_series_without_documented_panel_settings_is_reported(capsys):
    assert main(["models", "setup", "optidrive-plus"]) == 0
    assert "no panel setting of this series is documented in our sources" in capsys.readouterr().out


def test_html_page_is_one_printable_file(plant, capsys, tmp_path):
    path = tmp_path / "pump.html"
    assert main(["models", "setup", "--for", "pump", "--plant", plant, "--html", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert "<title>pump: set-up sheet" in text
    assert "P2010[0]" in text
    assert "19200 baud = 7" in text
    assert "V20 operating instructions 07/2012 p. 111" in text
    capsys.readouterr()
    assert text.count("☐") == len(rows(capsys, "--for", "pump", "--plant", plant))
    assert "background: #fff" in text
    assert not re.search(r"<script|<link|src=|https?://", text), "nothing comes from elsewhere"
    assert main(["models", "setup", "v20", "--html", str(path)]) == 2, "it is not replaced"
    assert main(["models", "setup", "uss/v20", "--html", str(path), "--force"]) == 0


@pytest.mark.usefixtures("plant")
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "name a series, or a drive with --for"),
        (["nothing"], "no protocol has a model 'nothing'"),
        (["--for", "fan", "--plant", "hall.toml"], "fan (danfoss-fc:3) has no model; name its series"),
        (
            ["modbus/yaskawa", "--for", "pump", "--plant", "hall.toml"],
            "is a series of modbus, and pump (uss:3) speaks uss",
        ),
        (["--for", "pumb", "--plant", "hall.toml"], "did you mean 'pump'?"),
        (["uss/v20", "--plant", "hall.toml"], "--plant has no effect without --for"),
        (["uss/v20", "--force"], "--force has no effect without --html"),
    ],
)
def test_setup_refuses_wrong_arguments(capsys, words, sentence):
    assert main(["models", "setup", *words]) == 2
    assert sentence in capsys.readouterr().err
