"""The tags commands: a table of all values with their addresses, exported and imported again from a spreadsheet."""

import csv
import io
import json

import pytest

from drivecomm.cli import main
from drivecomm.plant import read_plant
from drivecomm.protocol import Tag

PLANT = """\
format = 1

[server]
name = "hall 2"
site = "Leeds"
area = "mixing"

[[door]]
kind = "http"

[[door]]
kind = "mqtt"
levels = ["site", "area", "line"]

[[door]]
kind = "mqtt"
messages = "drives"

[[door]]
kind = "sparkplug"
levels = ["site", "area", "plant", "line"]

[[door]]
kind = "opcua"
anonymous = "view"

[[door]]
kind = "modbus-tcp"
units = { pump = 7 }
registers = { pump = { "480" = 200 } }

[[line]]
name = "hall"

# the feed pump
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
poll = [{ parameters = ["output_frequency", "480"] }]

# nothing is polled of it but what is usual
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc302" }
"""


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plant.toml").write_text(PLANT)

    def call(*arguments):
        code = main(["tags", *arguments])
        captured = capfd.readouterr()
        return code, captured.out, captured.err

    return call


def rows_of(text):
    return {(row["drive"], row["parameter"]): row for row in csv.DictReader(io.StringIO(text))}


def test_every_value_is_exported_with_its_address_at_each_door(run):
    code, out, err = run("export", "plant.toml")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert list(rows) == [
        ("pump", "status"), ("pump", "output_frequency"), ("pump", "480"),
        ("fan", "status"), ("fan", "output_frequency"), ("fan", "output_current"),
    ]  # fmt: skip
    doors = ("mqtt", "mqtt 2", "sparkplug", "opcua", "modbus-tcp")
    assert [rows["pump", "output_frequency"][door] for door in doors] == [
        "drivecomm/Leeds/mixing/hall/pump/output_frequency",
        "drivecomm/hall%202/pump/values output_frequency",
        "Leeds:mixing/hall 2/hall:pump/Values/output_frequency",
        "ns=2;s=drives/pump/Monitoring/ConverterOutputFrequency",
        "unit 7 register 8 float32",
    ]
    assert [rows["pump", "480"][door] for door in ("opcua", "modbus-tcp")] == [
        "ns=2;s=drives/pump/Parameters/480", "unit 7 register 200 float32",
    ]  # fmt: skip
    assert rows["pump", "status"]["modbus-tcp"] == "unit 7 register 1 uint16"
    assert rows["pump", "status"]["sparkplug"] == "Leeds:mixing/hall 2/hall:pump/Status/State"
    assert rows["fan", "status"]["modbus-tcp"] == ""


def test_import_of_an_unchanged_export_changes_nothing(run, tmp_path):
    before = (tmp_path / "plant.toml").read_bytes()
    assert run("export", "plant.toml", "tags.csv") == (0, "tags.csv: 6 values\n", "")
    assert (tmp_path / "tags.csv").read_bytes().startswith(b"\xef\xbb\xbftag,drive,line,parameter,")
    assert run("import", "tags.csv", "plant.toml") == (0, "plant.toml: 0 tags changed\n", "")
    assert (tmp_path / "plant.toml").read_bytes() == before
    code, _, err = run("export", "plant.toml", "tags.csv")
    assert (code, "exists already" in err) == (2, True)
    assert run("export", "plant.toml", "tags.csv", "--force")[0] == 0


def test_imported_tags_are_exported(run, tmp_path):
    (tmp_path / "new.csv").write_text("tag;drive;parameter;deadband;remark\nF1.A;fan;output_current;0,5;ours\n")
    code, out, err = run("import", "new.csv", "plant.toml")
    assert (code, out) == (0, "plant.toml: 1 tag changed\n")
    assert err == "drivecomm: new.csv: columns that are ignored: remark\n"
    # The fan is still polled for the usual values.
    row = rows_of(run("export", "plant.toml")[1])["fan", "output_current"]
    assert (row["tag"], row["deadband"]) == ("F1.A", "0.5")
    assert read_plant(tmp_path / "plant.toml").drives[1].tags == {"output_current": Tag(name="F1.A", deadband=0.5)}
    assert "# nothing is polled of it but what is usual\n[[drive]]" in (tmp_path / "plant.toml").read_text()


def test_import_changes_nothing_unless_every_row_is_valid(run, tmp_path):
    (tmp_path / "new.csv").write_text("tag,drive,parameter\nF1.A,fan,output_current\nx,fna,status\ny,fan,481\n")
    code, out, err = run("import", "new.csv", "plant.toml")
    assert (code, out) == (2, "")
    first, second, last = err.splitlines()
    assert first.startswith("drivecomm: new.csv, line 3: there is no drive 'fna'; did you mean 'fan'?")
    assert second.startswith("drivecomm: new.csv, line 4: fan has no value '481'")
    assert last == "drivecomm: new.csv: 2 rows cannot be imported, so nothing was changed in plant.toml; see above"
    assert (tmp_path / "plant.toml").read_text() == PLANT


def test_export_prints_json_objects(run):
    code, out, _ = run("export", "plant.toml", "--json")
    rows = [json.loads(line) for line in out.splitlines()]
    assert (code, len(rows), rows[0]["drive_name"]) == (0, 6, "pump")


def test_table_in_another_encoding_is_refused(run, tmp_path):
    (tmp_path / "new.csv").write_bytes("tag;drive;parameter\nLüfter;fan;status\n".encode("cp1252"))
    code, _, err = run("import", "new.csv", "plant.toml")
    assert (code, "save the file in UTF-8" in err) == (2, True)
