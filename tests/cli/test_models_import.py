"""The models import command, which makes a model from a file of another program."""

import sys
from pathlib import Path

import click
import pytest

from drivecomm.models import read_model
from drivecomm.virtual import virtual_drive

FILES = Path(__file__).parents[1] / "commissioning" / "importing" / "files"


@pytest.fixture
def imported(shell, tmp_path, monkeypatch):
    """Return a function that runs models import in an empty folder, without a port."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: shell("models", "import", *map(str, arguments), port="")


def test_import_writes_a_model_and_the_printed_next_step_works(imported, shell, tmp_path):
    assert imported(FILES / "home-assistant.yaml", "--address", "5", "--yes") == 0
    path = tmp_path / "home-assistant.toml"
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# Imported from home-assistant.yaml, Home Assistant Modbus section (YAML). Monitoring only")
    assert "# Not carried over: modbus[0].sensors[3]: scale 1, offset -40: a model has a factor" in text
    last = shell.out.splitlines()[-1]
    assert last.startswith("written to home-assistant.toml, monitoring only; next: drivecomm read modbus:5 output_freq")
    step = last.partition("next: drivecomm ")[2].removesuffix("--port /dev/ttyUSB0").split()
    shell.line(virtual_drive("modbus", 5, model=str(path)))
    assert shell(*step) == 0
    assert "0.00 Hz" in shell.out
    assert shell("models", "list", "modbus", port="") == 0
    assert shell("models", "show", str(path), port="") == 0
    assert "monitoring only" in shell.out


def test_import_prints_columns_register_base_and_omissions(imported, shell):
    imported(FILES / "lueftung.csv", "--yes")
    assert "columns: address = 'Adresse', name = 'Bezeichnung'" in shell.out
    assert "40001 is holding register 0" in shell.out
    assert "not carried over: line 12: type ASCII: not a type whose width and sign are certain" in shell.out


def test_import_writes_nothing_without_confirmation(imported, shell, tmp_path):
    assert imported(FILES / "grblhal.txt") == 1
    assert shell.out.splitlines()[-1] == "nothing is written; --yes writes grblhal.toml"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("answer", "written"), [("y", True), ("", False)])
def test_import_asks_for_confirmation_on_a_terminal(imported, monkeypatch, tmp_path, answer, written):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    asked = []
    monkeypatch.setattr(click, "confirm", lambda text, **_: asked.append(text) or answer == "y")
    assert imported(FILES / "grblhal.txt", "--output", "mill.toml") == int(not written)
    assert asked == ["Write mill.toml?"]
    assert (tmp_path / "mill.toml").exists() is written


def test_existing_model_is_replaced_only_with_force(imported, shell, tmp_path):
    path = tmp_path / "grblhal.toml"
    path.write_text("mine", encoding="utf-8")
    assert imported(FILES / "grblhal.txt", "--yes") == 2
    assert "exists already" in shell.err
    assert path.read_text(encoding="utf-8") == "mine"
    assert imported(FILES / "grblhal.txt", "--yes", "--force") == 0
    assert read_model(path, "modbus").name == "grblhal"


def test_file_of_several_drives_needs_one_of_their_addresses(imported, shell):
    assert imported(FILES / "home-assistant.yaml", "--yes") == 2
    assert "the file reads drives 5, 6; choose one with --address" in shell.err
    assert imported(FILES / "home-assistant.yaml", "--address", "9", "--yes") == 2
    assert "does not read drive 9, only 5, 6" in shell.err


def test_register_base_flag_overrides_the_guess_from_the_addresses(imported, shell, tmp_path):
    assert imported(FILES / "nasos.csv", "--register-base", "0", "--yes") == 0
    assert "(assumed" not in shell.out
    assert imported(FILES / "lueftung.csv", "--register-base", "1", "--yes") == 0
    assert read_model(tmp_path / "lueftung.toml", "modbus").parameters["40102"].title == "Ausgangsfrequenz"
    assert imported(FILES / "telegraf.conf", "--register-base", "1", "--yes") == 2
    assert "whose addresses are those of telegrams" in shell.err


def test_import_emits_json_and_writes_nothing_without_yes(imported, shell, tmp_path):
    assert imported(FILES / "telegraf.conf", "--json") == 1
    first, *others, last = shell.objects
    assert first["form"] == "Telegraf Modbus section (TOML)"
    assert next(each["place"] for each in others if "place" in each).endswith("holding_registers[3]")
    assert last == {"file": ""}
    assert imported(FILES / "telegraf.conf", "--json", "--yes") == 0
    assert shell.objects[-1]["file"] == "telegraf.toml"
    assert (tmp_path / "telegraf.toml").exists()


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.csv", "1,2\n3,4\n", "not a file that can be imported; supported are register lists"),
        ("b.json", "{", "cannot be read as JSON"),
        ("c.json", '{"a": 1}', "not a file that can be imported"),
        ("d.yaml", "modbus: [", "cannot be read as YAML"),
        ("e.conf", "[[inputs.modbus]]\n=", "cannot be read as TOML"),
        ("f.yaml", "Huanyang:\n  modbus_id: 1\n", "FluidNC has the registers of this spindle built in"),
        ("h.xlsx", "PK\x03\x04", "save the sheet with the registers as CSV"),
        ("g.csv", "Address,Name,Offset\n1,Temperature,5\n", "names no register that can be read (line 2: offset 5"),
    ],
)
def test_file_that_cannot_be_imported_is_refused_with_the_reason(imported, shell, name, text, says):
    Path(name).write_text(text, encoding="utf-8")
    assert imported(name, "--yes") == 2
    assert says in shell.err
    assert not list(Path().glob("*.toml"))


def test_missing_file_is_named(imported, shell):
    assert imported("none.csv", "--yes") == 2
    assert "none.csv" in shell.err


def test_yaml_import_without_its_library_names_the_extra(imported, shell, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    assert imported(FILES / "fluidnc.yaml", "--yes") == 2
    assert "install drivecomm[import]" in shell.err
